"""task=test: scores a checkpoint on the test split, in a folder beside the run's own."""

from omegaconf import DictConfig

from ..run_folder import RunFolder
from .evaluate import evaluate
from .model import module_of
from .session import Session


def test(cfg: DictConfig) -> None:
    """Writes ``results.csv`` and figures under ``<run>/test/`` for the checkpoint named, or under
    ``<run>/test-calibrated/``.

    Raises `UserError` as `Session` does.
    """
    session = Session(cfg)
    _ = session.trainer  # for its refusal of a device or a precision
    checkpoint, run = session.checkpoint("test"), session.folder
    network = checkpoint.network(cfg.calibrated)
    module = module_of(cfg, session.data, network, checkpoint.origin)
    # Not in the run's own folder, whose results say what its training ended with.
    path = run.path / ("test-calibrated" if cfg.calibrated else "test")
    evaluate(session, module, RunFolder(path, run.config, session.data.root.name))
