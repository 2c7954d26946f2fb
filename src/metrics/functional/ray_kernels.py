"""The march of camera rays, compiled for the CPU."""

import numpy as np

from ...jit import njit
from ...voxels import advance, enter, is_inside
from .codes import UNCOUNTED


@njit(nogil=True, error_model="numpy")
def march(codes, origin, directions, free_index, classes, distances):
    """Fills ``classes`` and ``distances`` [2, n] with what every ray meets: predicted, and true.

    ``codes`` are ``16 * target + prediction``, or 255 where nothing is counted.
    """
    for n in range(len(directions)):
        ray = enter(codes.shape, origin, directions[n])
        while is_inside(codes.shape, ray) and np.inf in (distances[0, n], distances[1, n]):
            code = codes[ray.cell]
            if code != UNCOUNTED:
                predicted, true = code & 15, code >> 4
                if distances[0, n] == np.inf and predicted != free_index:
                    classes[0, n], distances[0, n] = predicted, ray.distance
                if distances[1, n] == np.inf and true != free_index:
                    classes[1, n], distances[1, n] = true, ray.distance
            ray = advance(ray)
