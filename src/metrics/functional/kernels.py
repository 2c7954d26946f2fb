"""The pass over a frame's voxels that is compiled for the CPU."""

import numpy as np

from ...jit import njit
from .codes import CODES


@njit(nogil=True)
def count_frame(
    preds, target, mask, marked, shell, bins, n_bins, excess, classes, unknown, count, penalty
):
    """Adds all voxels of a frame to its tables; returns whether all counted class ids are sound.

    This is `kar_mean_iou` voxel by voxel, up to the division: the comments name its lines. A cell
    of the tables is ``16 * target + prediction``, after the cells of lower bins and, for voxels
    that are ``marked``, after all that are not. ``mask``, ``marked`` and ``bins`` may each be None.
    """
    # Most voxels are free and right: increments of one counter would wait for each other.
    parts = np.zeros((4, CODES), np.int64)
    for i in range(len(target)):
        # known = target != ignore_index; known = known & mask
        t = np.int64(target[i])
        if t == unknown:
            continue
        if mask is not None and not mask[i]:
            continue
        p = np.int64(preds[i])
        if t < 0 or t >= classes or p < 0 or p >= classes:
            return False

        cell = 16 * t + p
        if bins is not None:
            cell += CODES * np.int64(bins[shell[i]])
        if marked is not None and marked[i]:
            cell += CODES * n_bins

        # hits, and the 1 in weight = 1 + round(excess * FIXED_POINT) / FIXED_POINT
        if bins is None and marked is None:
            parts[i & 3, cell] += 1
        else:
            count[cell] += 1
        # errors = weight[true ^ predicted].sum(), in units of 1 / FIXED_POINT
        if t != p:
            penalty[cell] += excess[shell[i]]

    for part in parts:
        for cell in range(CODES):
            count[cell] += part[cell]
    return True
