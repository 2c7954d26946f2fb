"""The truth in sight, damaged: which loss of it lets a UAV collide?"""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Bool, Float

from ..bounds import require_at_least, require_choice
from ..errors import UserError
from ..geometry import VoxelGrid
from ..models.stream import StreamFrame
from ..ontology import CLASSES, FREE, GROUND
from .belief import Belief
from .perception import Truth, seen_by
from .true_occupancy import TrueOccupancy

# Damages of a share, from 0 to 1, and those of a length in metres.
SHARES = ("voxels", "objects", *CLASSES[:FREE], "phantoms")
LENGTHS = ("near", "far", "ahead", "grown")

Occupied = Bool[np.ndarray, "X Y Z"]


@dataclass
class Damaged:
    """`Truth` in sight, with one ``kind`` of damage to an ``amount``.

    - ``voxels``: that share of the occupied voxels is lost, in each frame anew;
    - ``objects``: that share of the connected objects is lost whole for all of a flight, the ground
      left out; a class: that share of the objects of this class;
    - ``phantoms``: that share of the free voxels is occupied, in each frame anew;
    - ``near`` and ``far``: what is nearer or farther than so many metres is lost;
    - ``ahead``: everything is so many metres farther ahead; ``grown``: thicker on every side.

    ``seed`` draws what is lost. Raises `UserError` for another kind, and an amount out of range.
    """

    name: str
    grid: VoxelGrid
    kind: str
    amount: float
    seed: int
    wants_image = False
    _truth: Truth = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_choice("perception.kind", self.kind, (*SHARES, *LENGTHS))
        require_at_least(0, "perception", vars(self), "amount", "seed")
        if self.kind in SHARES and self.amount > 1:
            raise UserError(f"perception.amount: {self.amount} of {self.kind}; give a share")
        self._truth = Truth("truth", self.grid, in_sight=False)

    def begin(self, truth: TrueOccupancy) -> None:
        self._rng = np.random.default_rng(self.seed)
        if self.kind == "objects":
            truth = truth.without(self._rng, self.amount, {*range(FREE)} - {GROUND})
        elif self.kind in CLASSES:
            truth = truth.without(self._rng, self.amount, {CLASSES.index(self.kind)})
        self._truth.begin(truth)

    def __call__(self, frame: StreamFrame) -> Belief:
        belief = self._truth(frame)
        occupied = self._damaged(belief.occupied > 0)
        known = seen_by(frame, self.grid, occupied)
        return Belief(occupied.astype(np.float32), known, belief.movable & occupied)

    def _damaged(self, occupied: Occupied) -> Occupied:
        if self.kind == "voxels":
            return occupied & (self._rng.random(occupied.shape) >= self.amount)
        if self.kind == "phantoms":
            return occupied | (self._rng.random(occupied.shape) < self.amount)
        if self.kind in ("near", "far"):
            near = distances_m(self.grid) < self.amount
            return occupied & (~near if self.kind == "near" else near)

        cells = round(self.amount / self.grid.voxel_m)
        if self.kind == "ahead":
            moved = np.zeros_like(occupied)
            moved[cells:] = occupied[: len(occupied) - cells]
            return moved
        if self.kind == "grown":
            thick = torch.from_numpy(occupied)[None].float()
            side = 2 * cells + 1
            return (torch.nn.functional.max_pool3d(thick, side, 1, cells) > 0)[0].numpy()
        return occupied


def distances_m(grid: VoxelGrid) -> Float[np.ndarray, "X Y Z"]:
    """Returns the distance of every voxel's center from the UAV."""
    return grid.centers().norm(dim=-1).numpy()
