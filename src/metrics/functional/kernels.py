"""What is compiled for the CPU: the pass over a frame's voxels, and the march of camera rays."""

import math

import numpy as np

from ...jit import njit
from ...voxels import advance, enter, is_inside
from .codes import CODES, NOTHING, UNCOUNTED


@njit(nogil=True)
def count_frame(codes, parts, shell, excess, count, penalty):
    """Adds all voxels of a frame to its counts.

    This is `kar_mean_iou` voxel by voxel, up to the division: the comments name its lines. A cell
    of them is a voxel's code (`encode`), after the cells of lower ``parts``, which may be
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


@njit(nogil=True, error_model="numpy")
def sweep(codes, logits, paths, ball, radius, free_index, met, known, said, log_odds):
    """Fills ``met``, ``known``, ``said`` and ``log_odds`` with what every path sweeps (`swept`).

    ``paths`` and ``radius`` are in voxels, and the center of voxel 0 is at 0. ``ball`` are the
    offsets, from the voxel that a point is in, of all voxels that may be near it. ``logits`` are
    None where there are only labels.
    """
    # Neighbouring points and paths sweep the same voxels: their odds are computed once.
    odds = np.full((0, 0, 0) if logits is None else codes.shape, -np.inf, np.float32)
    for n in range(len(paths)):
        for point in paths[n]:
            x, y, z = round(point[0]), round(point[1]), round(point[2])
            nearest = np.inf
            for offset in ball:
                i, j, k = x + offset[0], y + offset[1], z + offset[2]
                if not _holds(codes.shape, i, j, k) or codes[i, j, k] == UNCOUNTED:
                    continue
                distance2 = (i - point[0]) ** 2 + (j - point[1]) ** 2 + (k - point[2]) ** 2
                if distance2 > radius**2:
                    continue

                predicted, true = codes[i, j, k] & 15, codes[i, j, k] >> 4
                known[n] = 1
                said[n] |= predicted != free_index
                if true != free_index and distance2 < nearest:
                    nearest, first = distance2, true
                if logits is not None:
                    if odds[i, j, k] == -np.inf:
                        odds[i, j, k] = _log_odds(logits[:, i, j, k], free_index)
                    # NaN stays: it is refused afterwards.
                    if not odds[i, j, k] <= log_odds[n]:
                        log_odds[n] = odds[i, j, k]
            if nearest < np.inf and met[n] == NOTHING:
                met[n] = first


@njit(nogil=True)
def count_objects(codes, level, near, around, free_index, ground_index, objects):
    """Counts in ``objects`` [class, level] those with a voxel that is ``near`` (`ObjectMiss`), by
    the highest ``level`` of a voxel at one of the offsets ``around``, unless there truly is
    something else."""
    done = np.zeros(codes.shape, np.bool_)
    for first in np.ndindex(codes.shape):
        true = codes[first] >> 4
        if not near[first] or done[first] or codes[first] == UNCOUNTED:
            continue
        if true in (free_index, ground_index):
            continue

        highest = 0
        done[first] = True
        waiting = [first]
        while waiting:
            x, y, z = waiting.pop()
            highest = max(highest, _highest(codes, level, around, x, y, z, true, free_index))
            for i in range(max(x - 1, 0), min(x + 2, codes.shape[0])):
                for j in range(max(y - 1, 0), min(y + 2, codes.shape[1])):
                    for k in range(max(z - 1, 0), min(z + 2, codes.shape[2])):
                        code = codes[i, j, k]
                        if code >> 4 == true and code != UNCOUNTED and not done[i, j, k]:
                            done[i, j, k] = True
                            waiting.append((i, j, k))

        objects[true, highest] += 1


@njit
def _highest(codes, level, around, x, y, z, own, free_index):
    """Returns the highest level near a voxel, where the truth is of its class or free."""
    highest = 0
    for offset in around:
        i, j, k = x + offset[0], y + offset[1], z + offset[2]
        code = codes[i, j, k] if _holds(codes.shape, i, j, k) else UNCOUNTED
        if code != UNCOUNTED and (code >> 4 == own or code >> 4 == free_index):
            highest = max(highest, level[i, j, k])
    return highest


@njit
def _holds(shape, i, j, k):
    return 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]


@njit(nogil=True, error_model="numpy")
def _log_odds(scores, free_index):
    """Returns the logarithm of the odds that a voxel is anything but free."""
    highest = np.float32(-np.inf)
    for c in range(len(scores)):
        if c != free_index:
            highest = max(highest, scores[c])
    total = np.float32(0)
    for c in range(len(scores)):
        if c != free_index:
            total += math.exp(scores[c] - highest)
    return highest + math.log(total) - scores[free_index]
