"""The truth in sight, damaged: which loss of it lets a UAV collide?"""

from collections.abc import Set
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import torch
from jaxtyping import Int

from src.errors import UserError
from src.jit import njit
from src.limits import require_at_least, require_choice
from src.loop.belief import Belief
from src.loop.perception import MOVABLE, Perception, Truth, seen_by
from src.loop.true_occupancy import ClassIds, TrueOccupancy
from src.loop.vectors import Points, Semantics
from src.models.frame import StreamFrame
from src.ontology import CLASSES, FREE, GENERAL, GROUND
from src.sim.staging import generator_for

# Damages of a share, from 0 to 1, and those of a length in metres.
SHARES = ("voxels", "objects", *CLASSES[:FREE], "phantoms")
LENGTHS = ("near", "far", "ahead", "grown")
# Points of one class in touching cells of this side are one object.
OBJECT_CELL_M = 0.5


@dataclass
class Damaged(Perception):
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

    kind: str
    amount: float
    seed: int
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
            truth = without(truth, self._rng, self.amount, {*range(FREE)} - {GROUND})
        elif self.kind in CLASSES:
            truth = without(truth, self._rng, self.amount, {CLASSES.index(self.kind)})
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
            near = self.grid.centers().norm(dim=-1).numpy() < self.amount
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


def without(
    truth: TrueOccupancy, rng: np.random.Generator, share: float, classes: Set[int]
) -> TrueOccupancy:
    """Returns the truth without some of the objects of these classes, each lost with a chance.

    An object is an actor, or all points of one class that are connected.
    """
    points_m, class_id = truth.static[:2]
    objects = connected(points_m, class_id)
    lost = rng.random(objects.max(initial=-1) + 1) < share
    drawn = [rng.random() < share for _ in truth.actors]
    return truth.only(
        ~(lost[objects] & np.isin(class_id, list(classes))),
        [not (loses and each[0].class_id in classes) for loses, each in zip(drawn, truth.actors)],
    )


def connected(points_m: Points, class_id: ClassIds) -> Int[np.ndarray, "n"]:
    """Returns a number for each point, the same for those of one connected object: one class, in
    cells of `OBJECT_CELL_M` that touch, be it by a corner."""
    cell = np.floor(points_m / OBJECT_CELL_M).astype(np.int64)
    cell -= cell.min(axis=0, initial=0) - 1
    _, rows, layers = cell.max(axis=0, initial=0) + 2
    columns = (class_id * (cell[:, 0].max(initial=0) + 2) + cell[:, 0]) * rows + cell[:, 1]
    keys, index = np.unique(columns * layers + cell[:, 2], return_inverse=True)

    parent = np.arange(len(keys))
    sides = np.array([(i * rows + j) * layers + k for i, j, k in product((-1, 0, 1), repeat=3)])
    for step in sides[sides > 0]:
        at = np.searchsorted(keys, keys + step).clip(max=len(keys) - 1)
        touching = np.flatnonzero(keys[at] == keys + step)
        _join(parent, touching, at[touching])
    return np.unique(parent, return_inverse=True)[1][index]


@njit
def _join(parent, ones, others):
    """Joins the sets of pairs; in the end every member knows the first one of its set."""
    for n in range(len(ones)):
        a, b = ones[n], others[n]
        while parent[a] != a:
            a = parent[a]
        while parent[b] != b:
            b = parent[b]
        parent[max(a, b)] = min(a, b)
    for n in range(len(parent)):
        parent[n] = parent[parent[n]]
