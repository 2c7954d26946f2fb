"""What every voxel around the UAV truly holds, from points on all surfaces of a scene."""

import math
from collections.abc import Iterator, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import VoxelGrid, inverse
from ..ontology import FREE
from ..sim.scene import Scene
from ..sim.voxel_kernels import Lattice, count_votes, elect
from .vectors import Matrix, Numbers, Points, Semantics, Triangles, Vector, Voxels, numbered

# Surfaces have a point on every piece of this side: no voxel that one passes through its middle is
# missed, only corners of it.
SPACING_M = 0.25
# Side of the blocks in which points are looked up.
BLOCK_M = 8.0

ClassIds = UInt8[np.ndarray, "n"]


class TrueOccupancy:
    """The surfaces of a scene between two corners, as points; those of actors in their own frames.

    A voxel is what most of its points are; a tie goes to the rarer class.
    """

    def __init__(self, scene: Scene, lower_m: Vector, upper_m: Vector) -> None:
        triangles_m, class_id = Scene(scene.static, ()).triangles_at(0)
        low, high = triangles_m.min(axis=1), triangles_m.max(axis=1)
        near = ((high > lower_m) & (low < upper_m)).all(axis=1)
        triangles_m, class_id = triangles_m[near], class_id[near]

        points_m, face = points_on(triangles_m)
        near = ((points_m > lower_m) & (points_m < upper_m)).all(axis=1)
        self.static = _Blocks.of(points_m[near], class_id[face[near]])

        self.actors, self._last = [], None
        for actor in scene.actors:
            points_m, _ = points_on(actor.triangles_m)
            self.actors.append((actor, points_m, np.full(len(points_m), actor.class_id, np.uint8)))

    def only(self, points: Bool[np.ndarray, "n"], actors: Sequence[bool]) -> "TrueOccupancy":
        """Returns the truth with some of the ``static`` points and of the ``actors`` alone."""
        other = copy(self)
        other._last = None
        other.static = _Blocks.of(*(each[points] for each in self.static[:2]))
        other.actors = [each for each, kept in zip(self.actors, actors) if kept]
        return other

    def at(self, step: int, world_from_occ: Matrix, grid: VoxelGrid) -> tuple[Semantics, Voxels]:
        """Returns the class of every voxel at a step of the simulation, free where there is
        nothing, and the voxels with a moving actor."""
        # A moment is looked at by several: who flies, its twin, what scores it.
        key = step, world_from_occ.tobytes(), grid
        if self._last and self._last[0] == key:
            return self._last[1]

        occ_from_world = inverse(world_from_occ)
        lattice, free = Lattice.of(grid), np.ones(grid.shape, dtype=bool)
        votes = np.zeros((*grid.shape, FREE), dtype=np.int32)
        for actor, *points in self.actors:
            count_votes(votes, lattice, occ_from_world @ actor.world_from_actor[step], *points)
        moving = votes.any(axis=-1)

        for points in self.static.around(world_from_occ, grid):
            count_votes(votes, lattice, occ_from_world, *points)
        self._last = key, (elect(votes, free), moving)
        return self._last[1]


class _Blocks(NamedTuple):
    """Points and their classes, by the block of space that they lie in: those of a grid are found
    at once. Each block begins at one of the points ``first`` and ends before the next."""

    points_m: Points
    class_id: ClassIds
    first: Int[np.ndarray, "blocks+1"]
    middle_m: Float[np.ndarray, "blocks 3"]

    @classmethod
    def of(cls, points_m: Points, class_id: ClassIds) -> "_Blocks":
        block = np.floor(points_m / BLOCK_M).astype(np.int64)
        corner = block.min(axis=0, initial=0)
        _, rows, layers = block.max(axis=0, initial=0) - corner + 1
        key = ((block - corner) * [rows * layers, layers, 1]).sum(axis=1)
        order = np.argsort(key, kind="stable")
        first = np.unique(key[order], return_index=True)[1]
        middle_m = (block[order[first]] + 0.5) * BLOCK_M
        return cls(points_m[order], class_id[order], np.append(first, len(key)), middle_m)

    def around(self, world_from_occ: Matrix, grid: VoxelGrid) -> Iterator[tuple]:
        """Yields points and classes of all blocks that a grid may touch."""
        low, high = np.array(grid.lower_m), np.array(grid.upper_m)
        middle_m = (world_from_occ @ [*(low + high) / 2, 1.0])[:3]
        reach_m = (np.linalg.norm(high - low) + math.sqrt(3) * BLOCK_M) / 2
        apart_m = np.linalg.norm(self.middle_m - middle_m, axis=1)
        for n in np.flatnonzero(apart_m <= reach_m):
            part = slice(*self.first[n : n + 2])
            yield self.points_m[part], self.class_id[part]


def points_on(triangles_m: Triangles) -> tuple[Points, Numbers]:
    """Returns points at most `SPACING_M` apart on every triangle, and the triangle of each.

    They lie in rows along the shortest side, so that a thin triangle has few.
    """
    triangles_m = np.ascontiguousarray(triangles_m, dtype=np.float64)
    sides_m = np.linalg.norm(np.roll(triangles_m, -1, axis=1) - triangles_m, axis=-1)

    # The corner opposite the shortest side comes first; the last of the sides is then that one.
    order = (sides_m.argmin(axis=1)[:, None] + np.array([2, 0, 1])) % 3
    apex, u, v = np.take_along_axis(triangles_m, order[..., None], axis=1).swapaxes(0, 1)
    one_m, short_m, other_m = np.take_along_axis(sides_m, order, axis=1).T

    rows = np.ceil(np.maximum(one_m, other_m) / SPACING_M).astype(int).clip(1)
    face, row = numbered(rows + 1)
    share = row / rows[face]
    pieces = np.ceil(share * short_m[face] / SPACING_M).astype(int)
    at, piece = numbered(pieces + 1)
    face, share = face[at], share[at, None]
    across = (piece / pieces[at].clip(1))[:, None]
    way = (1 - across) * (u - apex)[face] + across * (v - apex)[face]
    return apex[face] + share * way, face
