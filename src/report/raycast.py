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


@njit(error_model="numpy")
def cast(occupied, origin, directions, sun, floor):
    """Follow rays from one origin to the first occupied voxel, else to the plane ``z = floor``.

    ``occupied`` is bool [X, Y, Z], ``origin`` [3], ``directions`` [n, 3] and ``sun``, which points
    towards the sun, [3]. The plane ends with the grid's footprint.
    """
    n_rays = len(directions)
    hits = PixelHits(
        np.zeros(n_rays, np.uint8),
        np.zeros((n_rays, 3), np.int32),
        np.full(n_rays, np.inf),
        np.full(n_rays, 2, np.int8),
        np.ones(n_rays, np.int8),
        np.full(n_rays, 0.5, np.float32),
        np.ones(n_rays, np.float32),
        np.ones(n_rays, np.bool_),
    )
    before = np.empty(3, np.int64)
    for n in range(n_rays):
        direction = directions[n]
        cell, distance, axis = first_hit(occupied, origin, direction)
        kind, side = VOXEL, 1
        if axis < 0:
            kind, axis = FLOOR, 2
            distance = (floor - origin[2]) / direction[2] if direction[2] != 0.0 else -1.0
        elif direction[axis] > 0:
            side = -1

        point = origin + distance * direction
        if kind == VOXEL:
            hits.voxel[n, 0], hits.voxel[n, 1], hits.voxel[n, 2] = cell
            hits.edge[n], hits.openness[n] = _face(occupied, point, cell, axis, side, before)
        else:
            over = 0 <= point[0] < occupied.shape[0] and 0 <= point[1] < occupied.shape[1]
            if distance <= 0 or not over:
                continue
        hits.kind[n], hits.distance[n] = kind, distance
        hits.axis[n], hits.side[n] = axis, side
        # A point on a face may round into either voxel; a step off the face decides.
        point[axis] += 1e-4 * side
        lit = sun[axis] * side > 0
        hits.sunlit[n] = lit and first_hit(occupied, point, sun)[2] < 0

    return hits


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
