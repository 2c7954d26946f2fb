"""How far every cell is from the nearest occupied one."""

import numpy as np
from jaxtyping import Bool, Float

from ..jit import njit


@njit
def distances(occupied: Bool[np.ndarray, "X Y Z"], reach: int) -> Float[np.ndarray, "X Y Z"]:
    """Returns the distance between centers in cells, exact up to ``reach`` and no more than that.

    The squares are separable: along z first, then along y, then along x.
    """
    most = np.float32(reach * reach)
    nx, ny, nz = occupied.shape
    along_z = np.full((nx, ny, nz), most)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if occupied[i, j, k]:
                    for other in range(max(k - reach + 1, 0), min(k + reach, nz)):
                        square = np.float32((other - k) * (other - k))
                        along_z[i, j, other] = min(along_z[i, j, other], square)

    along_y = np.full((nx, ny, nz), most)
    for i in range(nx):
        for j in range(ny):
            for other in range(max(j - reach + 1, 0), min(j + reach, ny)):
                square = np.float32((other - j) * (other - j))
                for k in range(nz):
                    along_y[i, j, k] = min(along_y[i, j, k], along_z[i, other, k] + square)

    nearest = np.full((nx, ny, nz), most)
    for i in range(nx):
        for other in range(max(i - reach + 1, 0), min(i + reach, nx)):
            square = np.float32((other - i) * (other - i))
            for j in range(ny):
                for k in range(nz):
                    nearest[i, j, k] = min(nearest[i, j, k], along_y[other, j, k] + square)
    return np.sqrt(nearest)


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
