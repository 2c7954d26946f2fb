"""What is believed about the space ahead, and how it is gathered into a map of the world."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import UserError
from ..geometry import VoxelGrid
from ..jit import njit
from ..ontology import FREE
from ..sim.voxel_kernels import Lattice
from .vectors import Matrix, Semantics, Vector, Voxels

# Of one observation, so that no single one is final.
SUREST = 0.98
# Of the whole evidence for a cell, in nats: what is seen anew soon outweighs what was seen before.
LEAST, MOST = -2.0, 3.5
# What may drive off counts as never seen below this, in nats.
FORGOTTEN = 0.5


class Belief(NamedTuple):
    """The prediction of a perception for one frame, in that frame's occ frame.

    ``occupied`` is the probability that a voxel is occupied; ``known`` marks the voxels for which
    it is defined; ``movable`` marks the voxels whose likeliest occupied class can drive off;
    ``semantics`` is the likeliest class, free included.
    """

    occupied: Float[np.ndarray, "X Y Z"]
    known: Voxels
    movable: Voxels
    semantics: Semantics

    @classmethod
    def sure(cls, semantics: Semantics, known: Voxels, movable: Voxels) -> "Belief":
        """Builds a belief with probabilities 0 or 1 from known labels."""
        return cls((semantics != FREE).astype(np.float32), known, movable, semantics)


@dataclass(frozen=True)
class Fusion:
    """What a probability is worth as evidence, in a map that adds up log-odds.

    ``neutral`` is the probability that says nothing: 0.5, or less for a UAV that shall be warned by
    less. ``half_m`` is the distance from the UAV at which evidence counts half: it counts
    ``1 / (1 + distance / half_m)``. Raises `UserError` for settings out of range.
    """

    neutral: float = 0.5
    half_m: float = math.inf

    def __post_init__(self) -> None:
        if not 0 < self.neutral < 1:
            raise UserError(f"task.fusion.neutral: {self.neutral}; give a number between 0 and 1")
        if not self.half_m > 0:
            raise UserError(f"task.fusion.half_m: {self.half_m}; give a distance above 0, or .inf")

    def evidence(
        self, occupied: Float[np.ndarray, "n"], distance_m: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Returns what is added to log-odds, for probabilities at distances from the UAV."""
        sure = np.clip(occupied, 1 - SUREST, SUREST)
        odds = np.log(sure / (1 - sure)) - np.float32(math.log(self.neutral / (1 - self.neutral)))
        return odds / (1 + (distance_m / self.half_m)).astype(np.float32)


class BeliefMap:
    """Log-odds of occupied in the cells of a lattice that lies still in the world around the UAV.

    It moves along by whole cells and forgets what it leaves. What may drive off it forgets wherever
    it is not seen again: the log-odds shrink with the time constant ``forget_s``. ``shape`` counts
    cells, of the side of the beliefs' voxels.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        cell_m: float,
        forget_s: float,
        fusion: Fusion | None = None,
    ) -> None:
        self.cell_m, self.forget_s = cell_m, forget_s
        self.fusion = fusion or Fusion()
        self.log_odds = np.zeros(shape, dtype=np.float32)
        self.seen, self.movable = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        self.first: np.ndarray | None = None

    @property
    def lower_m(self) -> Vector:
        """The lower corner of the first cell, in the world."""
        return self.first * self.cell_m

    def update(
        self, belief: Belief, grid: VoxelGrid, world_from_occ: Matrix, passed_s: float
    ) -> None:
        """Moves along with the UAV and adds a belief, ``passed_s`` after the last one.

        A cell takes the highest probability of the known voxels whose centers it holds. Raises
        `UserError` for a belief that holds no probabilities.
        """
        if not ((belief.occupied >= 0) & (belief.occupied <= 1)).all():
            raise UserError("the belief holds NaN, or what is no probability; look at the network")
        self._move_to(world_from_occ[:3, 3])
        self.log_odds[self.movable] *= math.exp(-passed_s / self.forget_s)
        forgotten = self.movable & (np.abs(self.log_odds) < FORGOTTEN)
        self.log_odds[forgotten], self.seen[forgotten] = 0.0, False

        held = np.full(self.log_odds.shape, -1.0, dtype=np.float32)
        lattice = Lattice(self.lower_m, self.cell_m)
        arrays = np.asarray(belief.occupied, np.float32), belief.known, belief.movable
        _gather(held, self.movable, *arrays, Lattice.of(grid), world_from_occ, lattice)
        told = held >= 0
        centers_m = (np.argwhere(told) + 0.5) * self.cell_m + self.lower_m
        distance_m = np.linalg.norm(centers_m - world_from_occ[:3, 3], axis=1)
        evidence = self.log_odds[told] + self.fusion.evidence(held[told], distance_m)
        self.log_odds[told] = np.clip(evidence, LEAST, MOST)
        self.seen |= told

    def occupied(self, threshold: float) -> Voxels:
        """Returns the cells that are more likely occupied than the threshold, in 0 to 1."""
        return self.seen & (self.log_odds > math.log(threshold / (1 - threshold)))

    def probability_near(self, place_m: Vector, reach_m: float) -> float:
        """Returns the highest probability of occupied among the cells of a cube that reaches so far
        to each side of a place; 0 if no cell there was seen."""
        cell = (place_m - self.lower_m) / self.cell_m - 0.5
        reach = reach_m / self.cell_m
        low = np.maximum(np.ceil(cell - reach), 0).astype(int)
        high = np.minimum(np.floor(cell + reach) + 1, self.log_odds.shape).astype(int)
        part = tuple(map(slice, low, np.maximum(high, low)))
        seen = self.log_odds[part][self.seen[part]]
        return float(1 / (1 + np.exp(-seen.max()))) if seen.size else 0.0

    def _move_to(self, place_m: Vector) -> None:
        """Puts the middle of the lattice at a place, to whole cells."""
        shape = np.array(self.log_odds.shape)
        first = np.round(place_m / self.cell_m).astype(int) - shape // 2
        if self.first is not None:
            moved = first - self.first
            for name in ("log_odds", "seen", "movable"):
                setattr(self, name, _shifted(getattr(self, name), moved))
        self.first = first


def _shifted(array: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Returns the part of an endless array of zeros that begins so many cells farther along."""
    wider = np.pad(array, [(max(-n, 0), max(n, 0)) for n in cells])
    part = (slice(max(n, 0), max(n, 0) + size) for n, size in zip(cells, array.shape))
    return np.ascontiguousarray(wider[tuple(part)])


@njit
def _gather(held, movable, occupied, known, may_move, voxels, world_from_occ, cells):
    """Writes the highest probability of the voxels in each cell, and whether that one may move."""
    for i in range(occupied.shape[0]):
        for j in range(occupied.shape[1]):
            for k in range(occupied.shape[2]):
                if not known[i, j, k]:
                    continue

                x = voxels.lower_m[0] + (i + 0.5) * voxels.side_m
                y = voxels.lower_m[1] + (j + 0.5) * voxels.side_m
                z = voxels.lower_m[2] + (k + 0.5) * voxels.side_m
                u = _cell(world_from_occ[0], x, y, z, cells.lower_m[0], cells.side_m)
                v = _cell(world_from_occ[1], x, y, z, cells.lower_m[1], cells.side_m)
                w = _cell(world_from_occ[2], x, y, z, cells.lower_m[2], cells.side_m)
                if 0 <= u < held.shape[0] and 0 <= v < held.shape[1] and 0 <= w < held.shape[2]:
                    cell = int(u), int(v), int(w)
                    if occupied[i, j, k] > held[cell]:
                        held[cell] = occupied[i, j, k]
                        movable[cell] = may_move[i, j, k]


@njit(inline="always")
def _cell(row, x, y, z, lower_m, side_m):
    """Returns one index of the cell of a place, from its row of the transform."""
    return np.floor((row[0] * x + row[1] * y + row[2] * z + row[3] - lower_m) / side_m)
