"""The truth in sight, damaged: which loss of it lets a UAV collide?"""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, UInt8

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_at_least, require_choice
from ..loop.belief import Belief
from ..loop.perception import MOVABLE, Truth, seen_by
from ..loop.true_occupancy import TrueOccupancy
from ..models.frame import StreamFrame
from ..ontology import CLASSES, FREE, GENERAL, GROUND
from ..sim.staging import generator_for

# Damages of a share, from 0 to 1, and those of a length in metres.
SHARES = ("voxels", "objects", *CLASSES[:FREE], "phantoms")
LENGTHS = ("near", "far", "ahead", "grown")

Semantics = UInt8[np.ndarray, "X Y Z"]


@dataclass
class Damaged:
    """`Truth` in sight, with one ``kind`` of damage to an ``amount``.

    - ``voxels``: that share of the occupied voxels is lost, in each frame anew;
    - ``objects``: that share of the connected objects is lost whole for all of a flight, the ground
      left out; a class: that share of the objects of this class;
    - ``phantoms``: that share of the free voxels is occupied, in each frame anew;
    - ``near`` and ``far``: what is nearer or farther than so many metres is lost;
    - ``ahead``: everything is so many metres farther ahead; ``grown``: thicker on every side.

    ``seed`` draws what is lost, for every flight anew. Raises `UserError` for another kind, and an
    amount out of range.
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

    def begin(self, truth: TrueOccupancy, flight: str) -> None:
        self._rng = generator_for(self.seed, "damage", flight)
        if self.kind == "objects":
            truth = truth.without(self._rng, self.amount, {*range(FREE)} - {GROUND})
        elif self.kind in CLASSES:
            truth = truth.without(self._rng, self.amount, {CLASSES.index(self.kind)})
        self._truth.begin(truth, flight)

    def __call__(self, frame: StreamFrame) -> Belief:
        belief = self._truth(frame)
        semantics = self._damaged(belief.semantics)
        known = seen_by(frame, self.grid, semantics != FREE)
        if self.kind in ("ahead", "grown"):
            return Belief.sure(semantics, known, np.isin(semantics, MOVABLE))
        return Belief.sure(semantics, known, belief.movable & (semantics != FREE))

    def _damaged(self, semantics: Semantics) -> Semantics:
        free = np.uint8(FREE)
        if self.kind == "voxels":
            return np.where(self._rng.random(semantics.shape) < self.amount, free, semantics)
        if self.kind == "phantoms":
            drawn = self._rng.random(semantics.shape) < self.amount
            return np.where(drawn & (semantics == FREE), np.uint8(GENERAL), semantics)
        if self.kind in ("near", "far"):
            near = distances_m(self.grid) < self.amount
            return np.where(near == (self.kind == "near"), free, semantics)

        cells = round(self.amount / self.grid.voxel_m)
        if self.kind == "ahead":
            moved = np.full_like(semantics, FREE)
            moved[cells:] = semantics[: len(semantics) - cells]
            return moved
        if self.kind == "grown":
            # Free is the last class: the largest in a cube of the rest is what it is grown by.
            rest = torch.from_numpy(FREE - semantics)[None].float()
            largest = torch.nn.functional.max_pool3d(rest, 2 * cells + 1, 1, cells)[0].numpy()
            return np.where(semantics == FREE, FREE - largest.astype(np.uint8), semantics)
        return semantics


def distances_m(grid: VoxelGrid) -> Float[np.ndarray, "X Y Z"]:
    """Returns the distance of every voxel's center from the UAV."""
    return grid.centers().norm(dim=-1).numpy()
