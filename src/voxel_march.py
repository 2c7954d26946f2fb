"""How a ray goes through a voxel grid: an Amanatides-Woo march and its parts.

Everything is in grid coordinates: one unit is a voxel and voxel ``(i, j, k)`` covers
``[i, i+1) x [j, j+1) x [k, k+1)``; distances are in lengths of the ray's direction.
"""

import numpy as np

from .jit import njit


@njit(error_model="numpy")
def start(origin, direction, t, size):
    """Along one axis: the first voxel, the step, where the next voxel begins, and a voxel's width.

    The last two are distances along the ray.
    """
    cell = min(max(int(np.floor(origin + t * direction)), 0), size - 1)
    if direction == 0.0:
        return cell, 0, np.inf, np.inf
    step = 1 if direction > 0 else -1
    return cell, step, (cell + (step > 0) - origin) / direction, abs(1.0 / direction)


@njit(error_model="numpy")
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


@njit(error_model="numpy")
def first_hit(occupied, origin, direction, cell):
    """Distance to the first occupied voxel and the axis of the face; ``(inf, -1)`` for none.

    The voxel that holds the origin does not count. ``cell`` is set to the voxel that was hit.
    """
    t, axis = enter(occupied.shape, origin, direction)
    if t == np.inf:
        return np.inf, -1
    i, step_i, t_i, width_i = start(origin[0], direction[0], t, occupied.shape[0])
    j, step_j, t_j, width_j = start(origin[1], direction[1], t, occupied.shape[1])
    k, step_k, t_k, width_k = start(origin[2], direction[2], t, occupied.shape[2])
    while 0 <= i < occupied.shape[0] and 0 <= j < occupied.shape[1] and 0 <= k < occupied.shape[2]:
        if axis >= 0 and occupied[i, j, k]:
            cell[0], cell[1], cell[2] = i, j, k
            return t, axis
        if t_i < t_j and t_i < t_k:
            t, axis, i, t_i = t_i, 0, i + step_i, t_i + width_i
        elif t_j < t_k:
            t, axis, j, t_j = t_j, 1, j + step_j, t_j + width_j
        else:
            t, axis, k, t_k = t_k, 2, k + step_k, t_k + width_k
    return np.inf, -1
