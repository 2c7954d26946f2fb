"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from omegaconf import DictConfig

from ..run_folder import RunFolder
from .evaluate import evaluate
from .fit import trainer_of
from .trained import trained


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named.

    Raises `UserError` as `trained` does.
    """
    run, data, prior, module, precision = trained(cfg, "test")
    folder = RunFolder(run.path / "test", run.config)
    evaluate(cfg, folder, trainer_of(cfg, precision), module, data, prior)
