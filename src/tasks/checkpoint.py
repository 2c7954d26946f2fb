"""Checkpoint files: written whole or not at all, and how far the training was."""

from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import TorchCheckpointIO

from ..atomic import replacing


class WholeCheckpoints(TorchCheckpointIO):
    """Writes a checkpoint beside its place and renames it.

    Lightning writes it in the system's folder for temporary files. Where that is another disk, the
    move is a copy, and a run that is killed meanwhile has no last checkpoint any more.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Raises `UserError` where it cannot be written."""
        with replacing(path) as temporary:
            torch.save(checkpoint, temporary)


def epochs_done(checkpoint: Path) -> int:
    """How many epochs of training a checkpoint has seen."""
    return torch.load(checkpoint, map_location="cpu", weights_only=True, mmap=True)["epoch"] + 1
