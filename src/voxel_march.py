"""How a ray enters a voxel grid and where it starts: the parts of an Amanatides-Woo march.

Everything is in grid coordinates: one unit is a voxel and voxel ``(i, j, k)`` covers
``[i, i+1) x [j, j+1) x [k, k+1)``; distances are in lengths of the ray's direction.
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def start(origin, direction, t, size):
    """Along one axis: the first voxel, the step, where the next voxel begins, and a voxel's width.

    The last two are distances along the ray.
    """
    cell = min(max(int(np.floor(origin + t * direction)), 0), size - 1)
    if direction == 0.0:
        return cell, 0, np.inf, np.inf
    step = 1 if direction > 0 else -1
    return cell, step, (cell + (step > 0) - origin) / direction, abs(1.0 / direction)


@njit(cache=True, error_model="numpy")
def enter(shape, origin, direction):
    """Where a ray enters the grid and through which axis; -1 where it starts inside."""
    t_in, t_out, axis = 0.0, np.inf, -1
    for a in range(3):
        if direction[a] == 0.0:
            if not 0 <= origin[a] < shape[a]:
                return np.inf, -1
            continue
        near = (0.0 - origin[a]) / direction[a]
        far = (shape[a] - origin[a]) / direction[a]
        if near > far:
            near, far = far, near
        if near > t_in:
            t_in, axis = near, a
        t_out = min(t_out, far)
    return (t_in, axis) if t_in < t_out else (np.inf, -1)
