"""Surface points, thinned as they come: in every small cube one point of each class is kept.

The number of points in a voxel then measures the area of the surfaces in it, not how often or from
how near they were scanned, and a clip's points stay few whatever the number of its scans.
"""

import numpy as np
import pandas as pd
from jaxtyping import Float, Int, UInt8

Points = Float[np.ndarray, "n 3"]
Classes = UInt8[np.ndarray, "n"]

# The side of these cubes.
POINT_CUBE_M = 0.1
# So many more points than were kept the last time are gathered before they are thinned.
GATHERED = 500_000

# In cubes: points lie within +-52 km of the origin.
_HALF_RANGE = 1 << 19


class PointSet:
    """Points of one frame, and their classes, in the order in which they came."""

    def __init__(self) -> None:
        self._points = [np.zeros((0, 3))]
        self._classes = [np.zeros(0, dtype=np.uint8)]
        self._gathered = 0

    def add(self, points_m: Points, class_id: Classes) -> None:
        """Adds points, of which those count whose cube has none of their class yet."""
        self._points.append(points_m)
        self._classes.append(class_id)
        self._gathered += len(points_m)
        if self._gathered > GATHERED:
            self.points()

    def points(self) -> tuple[Points, Classes]:
        """Returns all points kept, in metres, and their classes."""
        points_m, class_id = np.concatenate(self._points), np.concatenate(self._classes)
        new = ~pd.Index(_keys(points_m, class_id)).duplicated()
        self._points, self._classes, self._gathered = [points_m[new]], [class_id[new]], 0
        return self._points[0], self._classes[0]


def _keys(points_m: Points, class_id: Classes) -> Int[np.ndarray, "n"]:
    """Returns cube and class as one number: three times 20 bits, and 3 bits."""
    cube = np.floor(points_m / POINT_CUBE_M).astype(np.int64) + _HALF_RANGE
    return ((cube[:, 0] << 20 | cube[:, 1]) << 20 | cube[:, 2]) << 3 | class_id
