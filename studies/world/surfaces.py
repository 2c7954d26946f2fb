"""Exact surface areas in voxels: triangles clipped against every voxel that they reach.

Nothing is sampled. A triangle is cut into slabs of voxels along x, each piece along y, each of
those along z (Sutherland and Hodgman, 1974); the area of what is left counts for the voxel.
"""

import numpy as np
from jaxtyping import Float, UInt8

from src.geometry import VoxelGrid
from src.jit import njit
from src.ontology import OCCUPIED

# A triangle that six planes have cut has at most nine corners.
MOST_CORNERS = 12


def surface_areas(
    triangles_occ: Float[np.ndarray, "f 3 3"],
    class_id: UInt8[np.ndarray, "f"],
    grid: VoxelGrid,
    margin_m: float = 0.0,
) -> Float[np.ndarray, "X Y Z 8"]:
    """Returns the area in square metres of each class's surface in every voxel.

    Voxels are grown by ``margin_m`` on every side. All surfaces that are drawn count, also where
    one solid runs into another.
    """
    lower_m, upper_m = np.array([grid.lower_m, grid.upper_m], dtype=np.float64)
    low, high = triangles_occ.min(axis=1), triangles_occ.max(axis=1)

    near = ((high > lower_m - margin_m) & (low < upper_m + margin_m)).all(axis=1)
    areas_m2 = np.zeros((*grid.shape, len(OCCUPIED)))
    triangles = np.ascontiguousarray(triangles_occ[near], dtype=np.float64)
    _add_areas(areas_m2, triangles, class_id[near], lower_m, grid.voxel_m, margin_m)
    return areas_m2


@njit
def _add_areas(areas, triangles, classes, lower_m, voxel_m, margin_m):
    nx, ny, nz = areas.shape[:3]
    # A triangle, its part in a slab along x, of that the part along y, and of that along z.
    pieces = np.empty((4, MOST_CORNERS, 3))

    for f in range(len(triangles)):
        pieces[0, :3] = triangles[f]
        for x in range(*_span(pieces[0], 3, 0, lower_m, voxel_m, margin_m, nx)):
            at_x = _slab(pieces, 0, 3, 0, lower_m[0] + x * voxel_m, voxel_m, margin_m)
            for y in range(*_span(pieces[1], at_x, 1, lower_m, voxel_m, margin_m, ny)):
                at_y = _slab(pieces, 1, at_x, 1, lower_m[1] + y * voxel_m, voxel_m, margin_m)
                for z in range(*_span(pieces[2], at_y, 2, lower_m, voxel_m, margin_m, nz)):
                    at_z = _slab(pieces, 2, at_y, 2, lower_m[2] + z * voxel_m, voxel_m, margin_m)
                    areas[x, y, z, classes[f]] += _area(pieces[3], at_z)


@njit
def _span(piece, corners, axis, lower_m, voxel_m, margin_m, count):
    """Returns the voxels along an axis that a polygon reaches: first, and one after the last."""
    if corners < 3:
        return 0, 0

    low, high = np.inf, -np.inf
    for k in range(corners):
        low, high = min(low, piece[k, axis]), max(high, piece[k, axis])
    first = int(np.floor((low - margin_m - lower_m[axis]) / voxel_m))
    last = int(np.floor((high + margin_m - lower_m[axis]) / voxel_m))
    return max(first, 0), min(last + 1, count)


@njit
def _slab(pieces, level, corners, axis, low_m, voxel_m, margin_m):
    """Cuts the polygon of a level down to one slab of voxels, for the next level."""
    between = np.empty((MOST_CORNERS, 3))
    kept = _cut(pieces[level], corners, axis, low_m - margin_m, 1.0, between)
    return _cut(between, kept, axis, low_m + voxel_m + margin_m, -1.0, pieces[level + 1])


@njit
def _cut(piece, corners, axis, at_m, side, kept):
    """Keeps the part of a convex polygon on one side of a plane; returns its number of corners.

    A polygon that lies in the plane belongs to the upper side alone, as a voxel's lower face does.
    """
    count = 0
    for k in range(corners):
        corner, following = piece[k], piece[(k + 1) % corners]
        a, b = side * (corner[axis] - at_m), side * (following[axis] - at_m)
        if a > 0 or (a == 0 and (side > 0 or not (piece[:corners, axis] == at_m).all())):
            kept[count] = corner
            count += 1

        # An edge that crosses the plane leaves a corner in it.
        if (a > 0 and b < 0) or (a < 0 and b > 0):
            kept[count] = corner + a / (a - b) * (following - corner)
            kept[count, axis] = at_m
            count += 1
    return count


@njit
def _area(piece, corners):
    """Returns half the length of the sum of the cross products of a fan of triangles."""
    total = np.zeros(3)
    for k in range(1, corners - 1):
        u, v = piece[k] - piece[0], piece[k + 1] - piece[0]
        total[0] += u[1] * v[2] - u[2] * v[1]
        total[1] += u[2] * v[0] - u[0] * v[2]
        total[2] += u[0] * v[1] - u[1] * v[0]
    return 0.5 * np.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
