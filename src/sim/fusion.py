"""The fusion of a clip's scans (App. A.3), in which what stands and what moves are decoupled.

Static surfaces and free space are fused in the world, each moving actor's surface in its own frame.
"""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import VoxelGrid, transform
from .scene import SceneActor
from .sensors import Scan
from .voxel_kernels import Lattice, carve, centers_of, count_votes

Points = Float[np.ndarray, "n 3"]
Classes = UInt8[np.ndarray, "n"]

# Points are thinned as they come: in every cube of this side one of each class is kept.
POINT_CUBE_M = 0.1
# So many more points than were kept the last time are gathered before they are thinned.
GATHERED = 500_000

# In cubes: points lie within +-52 km of the origin.
_HALF_RANGE = 1 << 19


class PointSet:
    """Thinned points of one frame, and their classes, in the order in which they came.

    The number of points in a voxel then measures the area of the surfaces in it, not how often or
    from how near they were scanned, and a clip's points stay few whatever the number of its scans.
    """

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


class StaticMap:
    """Static surface points and free space of a clip, fused in the world frame.

    ``free`` says of each of the ``cells``, of side ``cell_m``, whether a ray passed: then it is 1.
    """

    def __init__(
        self, lower_m: Float[np.ndarray, "3"], upper_m: Float[np.ndarray, "3"], cell_m: float
    ) -> None:
        self.cells = Lattice(np.array(lower_m, dtype=np.float64), cell_m)
        shape = np.ceil((np.array(upper_m) - self.cells.lower_m) / cell_m).astype(int)
        self.free = np.zeros(shape, dtype=np.uint8)
        self._points = PointSet()

    def add(self, scan: Scan, range_m: float) -> None:
        """Adds the free space along every ray, and a point where a ray met something static."""
        self.add_points(scan)
        length_m = np.minimum(scan.hits.distance_m, range_m)
        carve(self.free, self.cells, scan.origin_m, scan.directions, length_m)

    def add_points(self, scan: Scan) -> None:
        """Adds the points alone."""
        static = scan.hits.actor_id == 0
        self._points.add(scan.points_m(static), scan.hits.class_id[static])

    def freeze(self) -> None:
        """Takes the cells that hold a point from the free space."""
        self.points_m, self.class_id = self._points.points()
        cell = np.floor((self.points_m - self.cells.lower_m) / self.cells.side_m).astype(int)
        cell = cell[((cell >= 0) & (cell < self.free.shape)).all(axis=1)]
        self.free[tuple(cell.T)] = 0

    def vote(
        self,
        votes: Int[np.ndarray, "X Y Z 8"],
        grid: VoxelGrid,
        occ_from_world: Float[np.ndarray, "4 4"],
    ) -> None:
        """Crops the fused points to the grid of one frame: each votes in the voxel around it.

        Points are moved, not voxels, so that no rotation of the frame opens holes.
        """
        count_votes(votes, Lattice.of(grid), occ_from_world, self.points_m, self.class_id)

    def free_in(
        self, grid: VoxelGrid, world_from_occ: Float[np.ndarray, "4 4"]
    ) -> Bool[np.ndarray, "X Y Z"]:
        """Returns the voxels whose center is in a cell that some ray passed and none ended in.

        The occ frame is upright, so that a column of voxels stands in one column of the map.
        """
        x, y, z = centers_of(grid)
        center_m = [of_x * x + of_y * y + offset for of_x, of_y, _, offset in world_from_occ[:3]]
        center_m[2] = center_m[2] + z

        cell, in_map = [], True
        for k, place_m in enumerate(center_m):
            index = np.floor((place_m - self.cells.lower_m[k]) / self.cells.side_m).astype(int)
            in_map = in_map & (index >= 0) & (index < self.free.shape[k])
            cell.append(np.clip(index, 0, self.free.shape[k] - 1))
        return in_map & (self.free[tuple(cell)] == 1)


class ActorMap:
    """Surface points of every actor in its own frame, from all scans of the clip."""

    def __init__(self) -> None:
        self._sets: dict[int, PointSet] = defaultdict(PointSet)

    def add(self, scan: Scan, actors: Iterable[SceneActor], step: int) -> None:
        """Adds the points where rays met actors, each in the frame of its actor."""
        for actor in actors:
            mine = scan.hits.actor_id == actor.actor_id
            if mine.any():
                world_from_actor = actor.world_from_actor[step]
                away_m = scan.points_m(mine) - world_from_actor[:3, 3]
                points_m = away_m @ world_from_actor[:3, :3]
                self._sets[actor.actor_id].add(points_m, scan.hits.class_id[mine])

    def freeze(self) -> None:
        """Ends the fusion: from here on there are `placed` points."""
        self.points_m = {actor_id: points.points()[0] for actor_id, points in self._sets.items()}

    def placed(self, actor: SceneActor, step: int) -> Float[np.ndarray, "n 3"]:
        """Returns the actor's points in the world, where it is at a step."""
        points_m = self.points_m.get(actor.actor_id, np.zeros((0, 3)))
        return transform(actor.world_from_actor[step], points_m)
