"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..run_folder import CONFIG, RunFolder, require_same_config
from .dataset import data_of, ready_dataset
from .evaluate import evaluate
from .fit import trainer_of
from .model import load_weights, module_of, prior_of
from .precision import precision_of_run


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named.

    Raises `UserError` for a checkpoint whose run had another model: the weights of one rung fit
    another, and would be scored with the wrong projection.
    """
    if cfg.ckpt_path is None:
        raise UserError("ckpt_path: task=test needs a checkpoint; give best, last or a file")
    run = RunFolder(Path(cfg.paths.run), OmegaConf.to_container(cfg, resolve=True))
    checkpoint = run.checkpoint(cfg.ckpt_path)
    if (checkpoint.parent.parent / CONFIG).is_file():
        require_same_config(checkpoint, run.config, part="model")
    data = data_of(cfg, ready_dataset(cfg))
    prior = prior_of(cfg, data)
    module = module_of(cfg, data, prior)
    load_weights(module, checkpoint)
    folder = RunFolder(run.path / "test", run.config)
    trainer = trainer_of(cfg, precision_of_run(cfg, checkpoint.parent.parent))
    evaluate(cfg, folder, trainer, module, data, prior)
