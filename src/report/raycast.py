"""Rays through a voxel grid: what each one hits, and how much light reaches that point.

An Amanatides-Woo march in numba. Everything is in grid coordinates: one unit is a voxel and voxel
``(i, j, k)`` covers ``[i, i+1) x [j, j+1) x [k, k+1)``.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..jit import njit
from ..voxels import first_hit

MISS, VOXEL, FLOOR = 0, 1, 2


class PixelHits(NamedTuple):
    """Per ray: what it hits (MISS, VOXEL, FLOOR), and for a hit the rest.

    ``voxel`` is the index of the voxel, ``distance`` in lengths of the ray's direction, ``axis``
    and ``side`` (-1 or 1) the direction of the face, ``edge`` the distance to the face's nearest
    edge in voxels (0 to 0.5), ``openness`` 1 in the open and 0 in a corner, ``sunlit`` whether
    nothing stands between the point and the sun.
    """

    kind: UInt8[np.ndarray, "n"]
    voxel: np.ndarray
    distance: Float[np.ndarray, "n"]
    axis: np.ndarray
    side: np.ndarray
    edge: Float[np.ndarray, "n"]
    openness: Float[np.ndarray, "n"]
    sunlit: Bool[np.ndarray, "n"]


def cast(
    occupied: Bool[np.ndarray, "X Y Z"],
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    sun: Float[np.ndarray, "3"],
    floor: float,
) -> PixelHits:
    """Follow rays from one origin to the first occupied voxel, else to the plane ``z = floor``.

    The plane ends with the grid's footprint. ``sun`` points towards the sun.
    """
    n = len(directions)
    hits = PixelHits(
        kind=np.zeros(n, np.uint8),
        voxel=np.zeros((n, 3), np.int32),
        distance=np.full(n, np.inf),
        axis=np.full(n, 2, np.int8),
        side=np.ones(n, np.int8),
        edge=np.full(n, 0.5, np.float32),
        openness=np.ones(n, np.float32),
        sunlit=np.ones(n, np.bool_),
    )
    _cast(occupied, origin, directions, sun, float(floor), hits)

    return hits


@njit(error_model="numpy")
def _cast(occupied, origin, directions, sun, floor, hits):
    before = np.empty(3, np.int64)
    point = np.empty(3)

    for n in range(len(directions)):
        direction = directions[n]
        cell, distance, axis = first_hit(occupied, origin, direction)
        if axis >= 0:
            side = -1 if direction[axis] > 0 else 1
            for a in range(3):
                point[a] = origin[a] + distance * direction[a]
            hits.kind[n] = VOXEL
            hits.voxel[n, 0], hits.voxel[n, 1], hits.voxel[n, 2] = cell
            hits.axis[n], hits.side[n] = axis, side
            hits.edge[n], hits.openness[n] = _face(occupied, point, cell, axis, side, before)
        else:
            side = 1
            distance = (floor - origin[2]) / direction[2] if direction[2] != 0.0 else -1.0
            for a in range(3):
                point[a] = origin[a] + distance * direction[a]
            if distance <= 0 or not _over_footprint(occupied, point):
                continue
            axis = 2
            hits.kind[n] = FLOOR
        hits.distance[n] = distance
        # A point on a face may round into either voxel; a step off the face decides.
        point[axis] += 1e-4 * side
        lit = sun[axis] * side > 0
        hits.sunlit[n] = lit and first_hit(occupied, point, sun)[2] < 0


@njit(error_model="numpy")
def _over_footprint(occupied, point):
    return 0 <= point[0] < occupied.shape[0] and 0 <= point[1] < occupied.shape[1]


@njit(error_model="numpy")
def _face(occupied, point, cell, axis, side, before):
    """Distance to the nearest edge of the face, and ambient occlusion blended from its corners.

    Each corner is as open as the three voxels before the face that touch it are empty.
    """
    b, c = (axis + 1) % 3, (axis + 2) % 3
    u, v = point[b] - cell[b], point[c] - cell[c]
    before[0], before[1], before[2] = cell[0], cell[1], cell[2]
    before[axis] += side
    openness = 0.0

    for i in (-1, 1):
        for j in (-1, 1):
            before[b], before[c] = cell[b] + i, cell[c]
            beside = _filled(occupied, before)
            before[b], before[c] = cell[b], cell[c] + j
            along = _filled(occupied, before)
            before[b], before[c] = cell[b] + i, cell[c] + j
            corner = _filled(occupied, before)
            # Where both sides are closed, the corner behind them is dark whatever stands in it.
            blocked = 3 if beside and along else beside + along + corner
            weight = (u if i > 0 else 1 - u) * (v if j > 0 else 1 - v)
            openness += weight * (3 - blocked) / 3

    return min(min(u, 1 - u), min(v, 1 - v)), openness


@njit(error_model="numpy")
def _filled(occupied, cell):
    for a in range(3):
        if cell[a] < 0 or cell[a] >= occupied.shape[a]:
            return False
    return occupied[cell[0], cell[1], cell[2]]
