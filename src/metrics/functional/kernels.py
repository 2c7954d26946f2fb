"""What is compiled for the CPU: the pass over a frame's voxels, and the march of camera rays."""

import numpy as np

from ...jit import njit
from ...voxels import advance, enter, is_inside
from .codes import CODES, UNCOUNTED


@njit(nogil=True)
def count_frame(codes, parts, shell, excess, count, penalty):
    """Adds all voxels of a frame to its tables.

    This is `kar_mean_iou` voxel by voxel, up to the division: the comments name its lines. A cell
    of the tables is a voxel's code (`encode`), after the cells of lower ``parts``, which may be
    None. Voxels that are not ``known`` have a cell of their own, which no class has.
    """
    # Most voxels are free and right: increments of one counter would wait for each other.
    counters = np.zeros((4, len(count)), np.int64)
    for i in range(len(codes)):
        cell = np.int64(codes[i])
        if parts is not None:
            cell += CODES * np.int64(parts[i])

        # hits, and the 1 in weight = 1 + round(excess * FIXED_POINT) / FIXED_POINT
        counters[i & 3, cell] += 1
        # errors = weight[true ^ predicted].sum(), in units of 1 / FIXED_POINT
        if codes[i] >> 4 != codes[i] & 15:
            penalty[cell] += excess[shell[i]]

    for counter in counters:
        count += counter


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
