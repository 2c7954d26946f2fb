"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from omegaconf import DictConfig

from ..run_folder import RunFolder
from .dataset import data_of, finished_dataset
from .evaluate import evaluate
from .fit import trainer_of
from .model import module_of
from .trained import trained


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named.

    Raises `UserError` as `trained` and `finished_dataset` do.
    """
    trainer = trainer_of(cfg)
    run, checkpoint = trained(cfg, "test")
    data = data_of(cfg, finished_dataset(cfg))
    module = module_of(cfg, data, checkpoint.network(), checkpoint.origin)
    folder = RunFolder(run.path / "test", run.config, data.root.name)
    evaluate(cfg, folder, trainer, module, data)
