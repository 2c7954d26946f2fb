"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from omegaconf import DictConfig

from ..run_folder import RunFolder
from .evaluate import evaluate
from .model import module_of
from .session import Session


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named.

    Raises `UserError` as `Session` does.
    """
    session = Session(cfg)
    trainer, run, checkpoint = session.trainer, session.folder, session.checkpoint("test")
    module = module_of(cfg, session.data, checkpoint.network(), checkpoint.origin)
    # Not in the run's own folder, whose results say what its training ended with.
    folder = RunFolder(run.path / "test", run.config, session.data.root.name)
    evaluate(cfg, folder, trainer, module, session.data)
