"""The march of camera rays, compiled for the CPU."""

import numpy as np

from ...jit import njit
from ...voxel_march import enter, start

UNCOUNTED = 255


@njit(nogil=True, error_model="numpy")
def march(codes, origin, directions, free_index, classes, distances):
    """Fills ``classes`` and ``distances`` [2, n] with what every ray meets: predicted, and true.

    ``codes`` are ``16 * target + prediction``, or 255 where nothing is counted.
    """
    for n in range(len(directions)):
        _march_one(codes, origin, directions[n], free_index, classes[:, n], distances[:, n])


@njit(nogil=True, error_model="numpy")
def _march_one(codes, origin, ray, free_index, classes, distances):
    size_x, size_y, size_z = codes.shape
    t, _ = enter(codes.shape, origin, ray)
    if t == np.inf:
        return
    i, step_i, t_i, width_i = start(origin[0], ray[0], t, size_x)
    j, step_j, t_j, width_j = start(origin[1], ray[1], t, size_y)
    k, step_k, t_k, width_k = start(origin[2], ray[2], t, size_z)

    while 0 <= i < size_x and 0 <= j < size_y and 0 <= k < size_z:
        code = codes[i, j, k]
        if code != UNCOUNTED:
            predicted, true = code & 15, code >> 4
            if distances[0] == np.inf and predicted != free_index:
                classes[0], distances[0] = predicted, t
            if distances[1] == np.inf and true != free_index:
                classes[1], distances[1] = true, t
            if distances[0] != np.inf and distances[1] != np.inf:
                return

        # On into the neighbour whose face the ray meets first.
        if t_i < t_j and t_i < t_k:
            t, i, t_i = t_i, i + step_i, t_i + width_i
        elif t_j < t_k:
            t, j, t_j = t_j, j + step_j, t_j + width_j
        else:
            t, k, t_k = t_k, k + step_k, t_k + width_k
