"""How far every cell is from the nearest occupied one."""

import numpy as np
from jaxtyping import Float

from ..jit import njit
from .vectors import Voxels


def distances(occupied: Voxels, reach: int) -> Float[np.ndarray, "X Y Z"]:
    """Returns the distance between centers in cells, exact up to ``reach`` and no more than that.

    The squares are separable: along x first, then along y, then along z. They are whole numbers
    below 256 for a ``reach`` up to 11, in as few bits as a processor can compare many of at once.
    """
    squares = np.where(occupied, 0, reach**2).astype(np.uint8)
    for _ in range(3):
        nearest = squares.copy()
        for away in range(1, reach):
            farther = squares + np.uint8(away**2)
            np.minimum(nearest[away:], farther[:-away], out=nearest[away:])
            np.minimum(nearest[:-away], farther[away:], out=nearest[:-away])
        # The next axis comes first, so that what is compared lies together.
        squares = np.ascontiguousarray(np.moveaxis(nearest, 0, -1))
    return np.sqrt(squares.astype(np.float32))


@njit
def distance_at(field, place):
    """Returns the distance at a place in cells, between the centers around it; far off outside."""
    u, v, w = place[0] - 0.5, place[1] - 0.5, place[2] - 0.5
    i, j, k = int(np.floor(u)), int(np.floor(v)), int(np.floor(w))
    if not (0 <= i < field.shape[0] - 1 and 0 <= j < field.shape[1] - 1):
        return np.inf
    if not 0 <= k < field.shape[2] - 1:
        return np.inf

    u, v, w = u - i, v - j, w - k
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                total += share * field[i + a, j + b, k + c]
    return total
