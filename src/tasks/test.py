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
    _ = session.trainer  # for its refusal of a device or a precision
    checkpoint, run = session.checkpoint("test"), session.folder
    module = module_of(cfg, session.data, checkpoint.network(), checkpoint.origin)
    # Not in the run's own folder, whose results say what its training ended with.
    evaluate(session, module, RunFolder(run.path / "test", run.config, session.data.root.name))
