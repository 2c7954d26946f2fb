"""Rays through a voxel grid: what each one hits, and whether the sun shines on that point.

Everything is in grid coordinates: one unit is a voxel and voxel ``(i, j, k)`` covers
``[i, i+1) x [j, j+1) x [k, k+1)``.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..jit import njit
from ..voxels import first_hit

# How far before a face a shadow is looked for: a point on it may round into either voxel.
OFF_THE_FACE = 1e-4


class PixelHits(NamedTuple):
    """Per ray: whether it hits a voxel, or else the floor, and for a hit the rest.

    ``voxel`` is the index of the voxel, ``distance`` in lengths of the ray's direction (infinite
    for a miss), ``normal`` the direction of the face, ``edge`` the distance to the face's nearest
    edge in voxels (0 to 0.5), ``sunlit`` whether nothing stands between the point and the sun.
    """

    on_voxel: Bool[np.ndarray, "n"]
    on_floor: Bool[np.ndarray, "n"]
    voxel: Int[np.ndarray, "n 3"]
    distance: Float[np.ndarray, "n"]
    normal: Int[np.ndarray, "n 3"]
    edge: Float[np.ndarray, "n"]
    sunlit: Bool[np.ndarray, "n"]


def cast(
    occupied: Bool[np.ndarray, "X Y Z"],
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    sun: Float[np.ndarray, "3"],
    floor: float,
) -> PixelHits:
    """Follows rays from one origin to the first occupied voxel, else to the plane ``z = floor``.

    ``sun`` points towards the sun. The plane ends with the grid's footprint.
    """
    origins = np.tile(origin, (len(directions), 1))
    voxel, distance, axis = _first_hits(occupied, origins, directions)
    on_voxel = axis >= 0
    # What meets no voxel may meet the floor, whose normal is the last axis.
    normal = np.eye(3, dtype=int)[axis]
    normal[on_voxel] *= -np.sign(directions[on_voxel]).astype(int)

    # A ray along the floor never meets it.
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(on_voxel, distance, (floor - origin[2]) / directions[:, 2])
        points = origin + distance[:, None] * directions
        # Along the normal a point lies on the lattice, so the second smallest is on the face.
        edge = np.sort(np.abs(points - np.rint(points)), axis=1)[:, 1]
    over = ((points >= 0) & (points < occupied.shape))[:, :2].all(axis=1)
    on_floor = ~on_voxel & (distance > 0) & over
    distance[~on_voxel & ~on_floor] = np.inf

    sunlit = (on_voxel | on_floor) & (normal @ sun > 0)
    before = points[sunlit] + OFF_THE_FACE * normal[sunlit]
    to_sun = np.tile(sun, (len(before), 1))
    sunlit[sunlit] = _first_hits(occupied, before, to_sun)[2] < 0
    return PixelHits(on_voxel, on_floor, voxel, distance, normal, edge, sunlit)


@njit(error_model="numpy")
def _first_hits(occupied, origins, directions):
    """Returns `first_hit` of every ray."""
    n_rays = len(directions)
    voxels, distances = np.empty((n_rays, 3), np.int64), np.empty(n_rays)
    axes = np.empty(n_rays, np.int64)
    for n in range(n_rays):
        cell, distances[n], axes[n] = first_hit(occupied, origins[n], directions[n])
        voxels[n, 0], voxels[n, 1], voxels[n, 2] = cell

    return voxels, distances, axes
