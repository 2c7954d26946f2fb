"""The loops of the annotation that numpy cannot run: over the cells of rays, and over points.

A `Lattice` places an array of voxels in space, or of the smaller cells of a map.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..geometry import VoxelGrid
from ..jit import njit
from ..voxels import advance, enter, is_inside

Points = Float[np.ndarray, "n 3"]


class Lattice(NamedTuple):
    """Cubes side by side: the lower corner of the first one (float64), and their side."""

    lower_m: Float[np.ndarray, "3"]
    side_m: float

    @classmethod
    def of(cls, grid: VoxelGrid) -> "Lattice":
        return cls(np.array(grid.lower_m, dtype=np.float64), grid.voxel_m)


def centers_of(grid: VoxelGrid) -> list[Float[np.ndarray, "*xyz"]]:
    """Returns x, y and z of the centers of a grid's voxels, which broadcast to its shape."""
    axes_m = [
        lower_m + (np.arange(count) + 0.5) * grid.voxel_m
        for lower_m, count in zip(grid.lower_m, grid.shape)
    ]
    return np.meshgrid(*axes_m, indexing="ij", sparse=True)


@njit(error_model="numpy")
def carve(
    free: UInt8[np.ndarray, "X Y Z"],
    cells: Lattice,
    origin_m: Float[np.ndarray, "3"],
    directions: Points,
    distance_m: Float[np.ndarray, "n"],
) -> None:
    """Marks every cell that a ray leaves before its end.

    The cell in which a ray ends is not marked: there is a surface in it. A ray that starts outside
    the map marks nothing.
    """
    origin = (origin_m - cells.lower_m) / cells.side_m
    for axis in range(3):
        if not 0 <= origin[axis] < free.shape[axis]:
            return

    direction = np.empty(3)
    for n in range(len(directions)):
        for axis in range(3):
            direction[axis] = directions[n, axis] / cells.side_m
        ray = enter(free.shape, origin, direction)
        while is_inside(free.shape, ray):
            cell = ray.cell
            ray = advance(ray)
            if ray.distance > distance_m[n]:
                break
            free[cell] = 1


@njit
def count_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    voxels: Lattice,
    occ_from_points: Float[np.ndarray, "4 4"],
    points_m: Points,
    class_id: UInt8[np.ndarray, "n"],
) -> None:
    """Adds one vote per point to its voxel and class; points outside the grid have none.

    Floor comes first and the bounds after it: a point just below the grid is outside.
    """
    cell = np.empty(3)
    for i in range(len(points_m)):
        for k in range(3):
            place_m = occ_from_points[k, 3]
            for axis in range(3):
                place_m += occ_from_points[k, axis] * points_m[i, axis]
            cell[k] = np.floor((place_m - voxels.lower_m[k]) / voxels.side_m)
        x, y, z = cell
        if 0 <= x < votes.shape[0] and 0 <= y < votes.shape[1] and 0 <= z < votes.shape[2]:
            votes[int(x), int(y), int(z), class_id[i]] += 1
