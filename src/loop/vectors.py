"""Names for the arrays of a flight, in metres in the world, and products that numba inlines."""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..jit import njit

Vector = Float[np.ndarray, "3"]
Points = Float[np.ndarray, "n 3"]
Triangles = Float[np.ndarray, "f 3 3"]
Matrix = Float[np.ndarray, "4 4"]
Voxels = Bool[np.ndarray, "X Y Z"]
Semantics = UInt8[np.ndarray, "X Y Z"]
Numbers = Int[np.ndarray, "n"]


def numbered(counts: Int[np.ndarray, "m"]) -> tuple[Numbers, Numbers]:
    """Returns owner and number within that owner of all parts, of which each owner has a count."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - (counts.cumsum() - counts)[owner]


@njit(inline="always")
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def apart(a, b):
    """Returns the distance of two places."""
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
