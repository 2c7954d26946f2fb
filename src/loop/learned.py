"""What a trained network believes of the space ahead, from the images of the front camera."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import torch

from ..errors import UserError
from ..geometry import VoxelGrid
from ..models.checkpoint import Checkpoint
from ..models.frame import StreamFrame
from ..models.stream import SkyOccStream
from ..ontology import FREE
from .belief import Belief
from .perception import MOVABLE, Perception, seen_by
from .true_occupancy import TrueOccupancy
from .vectors import Semantics


@dataclass
class Learned(Perception):
    """The network of a checkpoint, as it would run in flight.

    It knows what the camera sees, up to the surfaces that it believes in. ``image`` are the
    settings of the images. Raises `UserError` without a checkpoint, for one with another grid or
    other images, and for one that holds no calibration where it shall be ``calibrated``.
    """

    checkpoint: str | None
    image: Mapping
    calibrated: bool = False
    wants_image = True
    _stream: SkyOccStream = field(init=False, repr=False)

    def __post_init__(self) -> None:
        checkpoint = opened(self.checkpoint, self.grid)
        trained = checkpoint.origin.config["sim"]["image"]
        if dict(trained) != dict(self.image):
            raise UserError(
                f"sim.image: {dict(self.image)}; {self.checkpoint} was trained with {trained}; "
                "give the scale that it was trained at"
            )
        self._stream = SkyOccStream.of(checkpoint.path, calibrated=self.calibrated)

    def begin(self, truth: TrueOccupancy, flight: str) -> None:
        self._stream.reset()

    def __call__(self, frame: StreamFrame) -> Belief:
        probability = self._stream(frame).softmax(dim=0)
        occupied = (1 - probability[FREE]).numpy()
        # `max` finds the place five times faster than `argmax` does on a CPU.
        best = probability[:FREE].max(dim=0).indices.numpy()
        known = seen_by(frame, self.grid, occupied > 0.5)
        semantics = probability.max(dim=0).indices.to(torch.uint8).numpy()
        return Belief(occupied, known, np.isin(best, MOVABLE), semantics)


@dataclass
class Prior(Perception):
    """The voxel prior of a checkpoint: what is usually where, without a look at the image."""

    checkpoint: str | None
    _labels: Semantics = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._labels = opened(self.checkpoint, self.grid).origin.voxel_prior.numpy()

    def __call__(self, frame: StreamFrame) -> Belief:
        known = seen_by(frame, self.grid, self._labels != FREE)
        return Belief.sure(self._labels, known, np.isin(self._labels, MOVABLE))


def opened(path: str | None, grid: VoxelGrid) -> Checkpoint:
    """Reads a checkpoint of that grid. Raises `UserError` without one, and for another grid."""
    if path is None:
        raise UserError("ckpt_path: this perception needs a checkpoint; give a file")
    checkpoint = Checkpoint.read(path)
    trained = VoxelGrid(**checkpoint.origin.config["grid"])
    if trained != grid:
        raise UserError(
            f"ckpt_path: {path} knows the voxels from {list(trained.lower_m)} to "
            f"{list(trained.upper_m)} m, {list(trained.shape)}, and the planner another grid; give "
            "task.grid.lower_m, upper_m and shape these"
        )
    return checkpoint
