"""The passes over a frame's voxels that are compiled for the CPU."""

import numpy as np

from ...jit import njit

SOUND, BAD_TARGET, BAD_PREDS = 0, 1, 2
CODES = 256


@njit(nogil=True)
def count_frame(preds, target, shell, excess, num_classes, ignore_index, count, penalty):
    """Adds all voxels of a frame to its tables, and returns what is wrong with them.

    ``count`` and ``penalty`` have 256 entries, ``16 * target + prediction``; where the result is
    not SOUND they mean nothing.
    """
    # Most voxels are free and right: increments of one counter would wait for each other.
    parts = np.zeros((4, CODES), np.int64)
    for i in range(len(target)):
        t = np.int64(target[i])
        if t == ignore_index:
            continue
        p = np.int64(preds[i])
        if t < 0 or t >= num_classes:
            return BAD_TARGET
        if p < 0 or p >= num_classes:
            return BAD_PREDS
        code = 16 * t + p
        parts[i & 3, code] += 1
        if t != p:
            penalty[code] += excess[shell[i]]
    for part in parts:
        for code in range(CODES):
            count[code] += part[code]
    return SOUND


@njit(nogil=True)
def sort_frame(
    preds,
    target,
    mask,
    marked,
    shell,
    bins,
    n_bins,
    excess,
    num_classes,
    ignore_index,
    count,
    penalty,
):
    """As `count_frame`, of the voxels in ``mask``, by ``marked`` and by the bin of their distance.

    ``mask``, ``marked`` and ``bins`` may each be None.
    """
    for i in range(len(target)):
        t = np.int64(target[i])
        if t == ignore_index:
            continue
        if mask is not None and not mask[i]:
            continue
        p = np.int64(preds[i])
        if t < 0 or t >= num_classes:
            return BAD_TARGET
        if p < 0 or p >= num_classes:
            return BAD_PREDS
        cell = 0
        if bins is not None:
            cell = np.int64(bins[shell[i]])
        if marked is not None and marked[i]:
            cell += n_bins
        cell = CODES * cell + 16 * t + p
        count[cell] += 1
        if t != p:
            penalty[cell] += excess[shell[i]]
    return SOUND
