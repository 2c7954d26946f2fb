"""What a clip's scans say together: static geometry and free space in the world, and the surface of
every moving actor in its own frame (App. A.3: static and dynamic are decoupled)."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry import VoxelGrid, transform
from .point_set import PointSet
from .scene import SceneActor as Body
from .sensors import Scan
from .voxel_kernels import Lattice, carve, count_votes, look_up

TILE_M = 8.0
"""Points are sorted into square tiles of this side, so that a frame reads only those near it."""


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
        """Free space along every ray, and a point where a ray met something static."""
        self.add_points(scan)
        length_m = np.minimum(scan.hits.distance_m, range_m)
        carve(self.free, self.cells, scan.origin_m, scan.directions, length_m)

    def add_points(self, scan: Scan) -> None:
        """The points alone."""
        static = scan.hits.actor_id == 0
        self._points.add(scan.points_m(static), scan.hits.class_id[static])

    def freeze(self) -> None:
        """Sorts the points into tiles and takes the cells that hold one from the free space."""
        points_m, class_id = self._points.points()
        tile = np.floor(points_m[:, :2] / TILE_M).astype(np.int64)
        order = np.lexsort((tile[:, 1], tile[:, 0]))
        self.points_m, self.class_id, tile = points_m[order], class_id[order], tile[order]
        self._tiles, self._starts = np.unique(tile, axis=0, return_index=True)
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
        ends = np.append(self._starts[1:], len(self.points_m))
        for tile in np.flatnonzero(self._near(grid, occ_from_world)):
            part = slice(self._starts[tile], ends[tile])
            points_m, class_id = self.points_m[part], self.class_id[part]
            count_votes(votes, Lattice.of(grid), occ_from_world, points_m, class_id)

    def _near(
        self, grid: VoxelGrid, occ_from_world: Float[np.ndarray, "4 4"]
    ) -> Bool[np.ndarray, "n"]:
        """The tiles that can reach into a grid."""
        middle_m = (self._tiles + 0.5) * TILE_M
        middle = middle_m @ occ_from_world[:2, :2].T + occ_from_world[:2, 3]
        lower, upper = np.array([grid.lower_m, grid.upper_m])[:, :2]
        reach = TILE_M / 2**0.5
        return ((middle > lower - reach) & (middle < upper + reach)).all(axis=1)

    def free_in(
        self, grid: VoxelGrid, world_from_occ: Float[np.ndarray, "4 4"]
    ) -> Bool[np.ndarray, "X Y Z"]:
        """Voxels through the cell of whose center some ray passed, and in which none ended."""
        found = np.zeros(grid.shape, dtype=bool)
        look_up(found, Lattice.of(grid), world_from_occ, self.free, self.cells)
        return found


class ActorMap:
    """Surface points of every actor in its own frame, from all scans of the clip."""

    def __init__(self) -> None:
        self._sets: dict[int, PointSet] = defaultdict(PointSet)

    def add(self, scan: Scan, bodies: Iterable[Body], step: int) -> None:
        """The points where rays met actors, taken back to where each was at its origin."""
        met = set(np.unique(scan.hits.actor_id).tolist())
        for body in bodies:
            if body.actor_id in met:
                mine = scan.hits.actor_id == body.actor_id
                pose = body.world_from_actor[step]
                points_m = (scan.points_m(mine) - pose[:3, 3]) @ pose[:3, :3]
                self._sets[body.actor_id].add(points_m, scan.hits.class_id[mine])

    def freeze(self) -> None:
        """Ends the fusion."""
        self.points_m = {actor: points.points()[0] for actor, points in self._sets.items()}

    def placed(self, body: Body, step: int) -> Float[np.ndarray, "n 3"]:
        """The actor's points in the world, where it is at a step."""
        points_m = self.points_m.get(body.actor_id, np.zeros((0, 3)))
        return transform(body.world_from_actor[step], points_m)
