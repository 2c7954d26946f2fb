"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..run_folder import RunFolder
from .dataset import data_of, ready_dataset
from .evaluate import evaluate
from .fit import trainer_of
from .model import load_weights, module_of, prior_of


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named."""
    if cfg.ckpt_path is None:
        raise UserError("ckpt_path: task=test needs a checkpoint; give ckpt_path=FILE, or best or last")
    run = RunFolder(Path(cfg.paths.run), OmegaConf.to_container(cfg, resolve=True))
    named = {"best": run.best_checkpoint, "last": run.last_checkpoint}
    checkpoint = named.get(cfg.ckpt_path, Path(cfg.ckpt_path))
    data = data_of(cfg, ready_dataset(cfg))
    prior = prior_of(cfg, data)
    module = module_of(cfg, data, prior)
    load_weights(module, checkpoint)
    folder = RunFolder(run.path / "test", run.config)
    folder.path.mkdir(parents=True, exist_ok=True)
    evaluate(cfg, folder, trainer_of(cfg), module, data, prior)
