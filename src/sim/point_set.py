"""Surface points, thinned as they come: in every small cube one point of each class is kept.

The number of points in a voxel then measures the area of the surfaces in it, not how often or from
how near they were scanned, and a clip's points stay few whatever the number of its scans.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..jit import njit

Points = Float[np.ndarray, "n 3"]
Classes = UInt8[np.ndarray, "n"]

# The side of these cubes.
POINT_CUBE_M = 0.1

_EMPTY = -1
# In cubes: points lie within +-52 km of the origin.
_HALF_RANGE = 1 << 19


class PointSet:
    """Points of one frame, and their classes, in the order in which they came."""

    def __init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._classes: list[np.ndarray] = []
        self._table = np.full(1 << 12, _EMPTY, dtype=np.int64)
        self._count = 0

    def add(self, points_m: Points, class_id: Classes) -> None:
        """Keeps the points whose cube has none of their class yet."""
        keys = _keys(points_m, class_id)
        self._grow(self._count + len(keys))
        new = np.zeros(len(keys), dtype=bool)
        _insert(self._table, keys, new)
        self._count += int(new.sum())
        self._points.append(points_m[new])
        self._classes.append(class_id[new])

    def points(self) -> tuple[Points, Classes]:
        """Returns all points kept, in metres, and their classes."""
        points = [np.zeros((0, 3)), *self._points]
        classes = [np.zeros(0, dtype=np.uint8), *self._classes]
        return np.concatenate(points), np.concatenate(classes)

    def _grow(self, count: int) -> None:
        """Keeps the table at most half full."""
        size = len(self._table)
        while size < 2 * count:
            size *= 2
        if size > len(self._table):
            held = self._table[self._table != _EMPTY]
            self._table = np.full(size, _EMPTY, dtype=np.int64)
            _insert(self._table, held, np.zeros(len(held), dtype=bool))


def _keys(points_m: Points, class_id: Classes) -> Int[np.ndarray, "n"]:
    """Returns cube and class as one number: three times 20 bits, and 3 bits."""
    cube = np.floor(points_m / POINT_CUBE_M).astype(np.int64) + _HALF_RANGE
    return ((cube[:, 0] << 20 | cube[:, 1]) << 20 | cube[:, 2]) << 3 | class_id


@njit
def _insert(
    table: Int[np.ndarray, "size"], keys: Int[np.ndarray, "n"], new: Bool[np.ndarray, "n"]
) -> None:
    """Inserts keys into a hash table with linear probing; marks those that were not in it."""
    mask = len(table) - 1
    for i in range(len(keys)):
        key = keys[i]
        # Multiplying by 64 bits of the golden ratio spreads neighbouring cubes over the table.
        slot = ((key * -7046029254386353131) >> 20) & mask
        while table[slot] != _EMPTY and table[slot] != key:
            slot = (slot + 1) & mask
        if table[slot] == _EMPTY:
            table[slot] = key
            new[i] = True
