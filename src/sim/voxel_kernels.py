"""The two loops of the annotation that numpy cannot run: carving free space and counting votes."""

import numba
import numpy as np
from jaxtyping import Float, Int, UInt8


@numba.njit(cache=True)
def carve(
    free: UInt8[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    cell_m: float,
    origin_m: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    distance_m: Float[np.ndarray, "n"],
) -> None:
    """Marks every cell that a ray leaves before its end (Amanatides and Woo, 1987).

    The cell in which a ray ends is not marked: there is a surface in it. A ray that starts outside
    the map marks nothing.
    """
    cell = np.empty(3, np.int64)
    step = np.empty(3, np.int64)
    until_m = np.empty(3)
    across_m = np.empty(3)
    for ray in range(len(directions)):
        for axis in range(3):
            place = (origin_m[axis] - lower_m[axis]) / cell_m
            cell[axis] = int(np.floor(place))
            along = directions[ray, axis]
            step[axis] = 1 if along > 0 else -1
            across_m[axis] = cell_m / abs(along) if along != 0 else np.inf
            rest = cell[axis] + 1 - place if along > 0 else place - cell[axis]
            until_m[axis] = rest * across_m[axis] if along != 0 else np.inf
        while (
            0 <= cell[0] < free.shape[0]
            and 0 <= cell[1] < free.shape[1]
            and 0 <= cell[2] < free.shape[2]
        ):
            axis = np.argmin(until_m)
            if until_m[axis] > distance_m[ray]:
                break
            free[cell[0], cell[1], cell[2]] = 1
            cell[axis] += step[axis]
            until_m[axis] += across_m[axis]


@numba.njit(cache=True)
def count_votes(
    votes: Int[np.ndarray, "X Y Z C"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    occ_from_world: Float[np.ndarray, "4 4"],
    points_m: Float[np.ndarray, "n 3"],
    class_id: UInt8[np.ndarray, "n"],
) -> None:
    """Adds one vote per world point to its voxel and class; points outside the grid have none."""
    for i in range(len(points_m)):
        inside = True
        cell = (0, 0, 0)
        for axis in range(3):
            along = occ_from_world[axis, 3]
            for k in range(3):
                along += occ_from_world[axis, k] * points_m[i, k]
            index = int(np.floor((along - lower_m[axis]) / voxel_m))
            if index < 0 or index >= votes.shape[axis]:
                inside = False
                break
            if axis == 0:
                cell = (index, 0, 0)
            elif axis == 1:
                cell = (cell[0], index, 0)
            else:
                cell = (cell[0], cell[1], index)
        if inside:
            votes[cell[0], cell[1], cell[2], class_id[i]] += 1
