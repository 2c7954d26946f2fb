"""Perceptions that need no network: the whole truth, the truth in sight, or a constant."""

from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np
import torch

from ..data.rates import STEP_HZ
from ..errors import UserError
from ..geometry import VoxelGrid, camera_from_occ, world_from_occ
from ..knowledge import seen
from ..models.frame import StreamFrame
from ..ontology import CAR, FREE, GENERAL, LARGE_VEHICLE, VRU
from .belief import Belief
from .true_occupancy import TrueOccupancy
from .vectors import Voxels

MOVABLE = (LARGE_VEHICLE, CAR, VRU)


@dataclass
class Perception(Protocol):
    """Turns frames into beliefs. ``wants_image`` tells whether it looks at the images at all."""

    name: str
    grid: VoxelGrid
    wants_image: ClassVar[bool] = False

    def begin(self, truth: TrueOccupancy, flight: str) -> None:
        """Resets the perception for a new flight; ``truth`` is the true occupancy of its scene."""

    def __call__(self, frame: StreamFrame) -> Belief: ...


@dataclass
class Constant(Perception):
    """Calls every voxel occupied with the same probability: 0 sees nothing, 1 is afraid of all.

    Raises `UserError` for what is no probability.
    """

    occupied: float

    def __post_init__(self) -> None:
        if not 0 <= self.occupied <= 1:
            raise UserError(f"perception.occupied: {self.occupied}; give a number from 0 to 1")

    def __call__(self, frame: StreamFrame) -> Belief:
        shape = self.grid.shape
        everywhere, nowhere = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)
        semantics = np.full(shape, GENERAL if self.occupied > 0.5 else FREE, np.uint8)
        return Belief(np.full(shape, self.occupied, np.float32), everywhere, nowhere, semantics)


@dataclass
class Truth(Perception):
    """Knows what every voxel of the grid truly holds; with ``in_sight`` only of those that the
    camera can see, which are not hidden by occupied ones."""

    in_sight: bool
    _truth: TrueOccupancy = field(init=False, repr=False)

    def begin(self, truth: TrueOccupancy, flight: str) -> None:
        self._truth = truth

    def __call__(self, frame: StreamFrame) -> Belief:
        step = round(frame.time_s * STEP_HZ)
        matrix = world_from_occ(frame.world_from_body)
        semantics, moving = self._truth.at(step, matrix, self.grid)
        occupied = semantics != FREE
        known = seen_by(frame, self.grid, occupied) if self.in_sight else np.ones_like(occupied)
        return Belief.sure(semantics, known, moving)


def seen_by(frame: StreamFrame, grid: VoxelGrid, occupied: Voxels) -> Voxels:
    """Returns the voxels in a frame's view that no occupied one hides (`src.knowledge`)."""
    height, width = frame.image.shape[-2:]
    mount = torch.as_tensor(frame.world_from_body), torch.as_tensor(frame.body_from_camera)
    return seen(occupied, camera_from_occ(*mount), frame.pix_from_camera, (width, height), grid)
