"""The march of camera rays, compiled for the CPU."""

import numpy as np

from ...jit import njit
from ...voxels import advance, enter, is_inside

UNCOUNTED = 255


@njit(nogil=True, error_model="numpy")
def march(codes, origin, directions, free_index, classes, distances):
    """Fills ``classes`` and ``distances`` [2, n] with what every ray meets: predicted, and true.

    ``codes`` are ``16 * target + prediction``, or 255 where nothing is counted.
    """
    for n in range(len(directions)):
        _march_one(codes, origin, directions[n], free_index, classes[:, n], distances[:, n])


@njit(nogil=True, error_model="numpy")
def _march_one(codes, origin, direction, free_index, classes, distances):
    ray = enter(codes.shape, origin, direction)
    while is_inside(codes.shape, ray):
        code = codes[ray.cell]
        if code != UNCOUNTED:
            predicted, true = code & 15, code >> 4
            if distances[0] == np.inf and predicted != free_index:
                classes[0], distances[0] = predicted, ray.distance
            if distances[1] == np.inf and true != free_index:
                classes[1], distances[1] = true, ray.distance
            if distances[0] != np.inf and distances[1] != np.inf:
                return
        ray = advance(ray)
