"""How far every cell is from the nearest occupied one."""

import numpy as np
from jaxtyping import Bool, Float

from ..jit import njit


@njit
def distances(occupied: Bool[np.ndarray, "X Y Z"], reach: int) -> Float[np.ndarray, "X Y Z"]:
    """Returns the distance between centers in cells, exact up to ``reach`` and no more than that.

    The squares are separable: along z first, then along y, then along x. They are whole numbers,
    in as few bits as a processor can compare many of at once.
    """
    nx, ny, _ = occupied.shape
    along_z = _along_z(occupied, reach)
    along_y, nearest = np.full_like(along_z, reach**2), np.full_like(along_z, reach**2)
    for i in range(nx):
        for away in range(1 - reach, reach):
            first, last = max(-away, 0), min(ny - away, ny)
            _lower(along_y[i, first:last], along_z[i, first + away : last + away], away**2)
    for i in range(nx):
        for other in range(max(i - reach + 1, 0), min(i + reach, nx)):
            _lower(nearest[i], along_y[other], (other - i) ** 2)
    return np.sqrt(nearest.astype(np.float32))


@njit
def _along_z(occupied, reach):
    """Returns the squares of the distances to the nearest occupied cell of the same column."""
    nx, ny, nz = occupied.shape
    squares = np.empty(occupied.shape, dtype=np.int16)
    for i in range(nx):
        for j in range(ny):
            away = reach
            for k in range(nz):
                away = 0 if occupied[i, j, k] else min(away + 1, reach)
                squares[i, j, k] = away**2
            # On the way back the count goes on: it is no less than the distance already found.
            for k in range(nz - 1, -1, -1):
                away = 0 if occupied[i, j, k] else min(away + 1, reach)
                squares[i, j, k] = min(squares[i, j, k], np.int16(away**2))
    return squares


@njit
def _lower(squares, others, more):
    """Lowers squares to others that are ``more`` farther away, where those are less."""
    mine, theirs, more = squares.reshape(-1), others.reshape(-1), np.int16(more)
    for n in range(len(mine)):
        mine[n] = min(mine[n], np.int16(theirs[n] + more))


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
