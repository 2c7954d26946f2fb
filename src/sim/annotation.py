"""From sensor signals to labels: the chain of App. A.3, one function a stage.

Static geometry and free space are fused over the clip in the world frame; every actor's surface is
fused in the actor's own frame and placed where the actor is now. A frame is then labelled in its
occ frame, through the projection chain of `geometry` alone.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import (
    VoxelGrid,
    camera_from_occ,
    in_image,
    inverse,
    pixel_centres,
    project,
    transform,
    unproject,
    world_from_occ,
)
from ..ontology import FREE, RAREST_FIRST, UNKNOWN
from .scene import Body, Hits
from .sensors import Scan
from .voxel_kernels import carve, count_votes

FUSED_POINT_M = 0.1
"""Of the fused points of one class in a cube of this side, one is kept: votes then measure area."""

MIN_VISIBLE_PIXELS = 4
MIN_LIDAR_RETURNS = 3
"""An actor is placed where it is now if the camera or the LiDARs see at least this of it now."""


@dataclass(frozen=True)
class View:
    """What the front camera and the simulator say of one frame. Matrices are float64 tensors."""

    world_from_body: torch.Tensor
    body_from_camera: torch.Tensor
    pix_from_camera: torch.Tensor
    depth_m: Float[np.ndarray, "h w"]
    class_id: UInt8[np.ndarray, "h w"]
    actor_id: Int[np.ndarray, "h w"]

    @property
    def camera_from_occ(self) -> torch.Tensor:
        return camera_from_occ(self.world_from_body, self.body_from_camera)

    def rays(self, stride: int, range_m: float) -> Scan:
        """Every ``stride``-th pixel as a ray in the world; what is beyond the range is not hit."""
        rows, columns = slice(stride // 2, None, stride), slice(stride // 2, None, stride)
        height, width = self.depth_m.shape
        pix = pixel_centres(width, height)[rows, columns].reshape(-1, 2)
        ones = torch.ones(len(pix), dtype=torch.float64)
        through = unproject(pix, ones, self.pix_from_camera)
        reach = through.norm(dim=-1)
        world_from_camera = self.world_from_body @ self.body_from_camera
        directions = (through / reach[:, None]) @ world_from_camera[:3, :3].T
        depth_m = self.depth_m[rows, columns].reshape(-1)
        hits = Hits(
            depth_m * reach.numpy(),
            self.class_id[rows, columns].reshape(-1),
            self.actor_id[rows, columns].reshape(-1),
        )
        return Scan(world_from_camera[:3, 3].numpy(), directions.numpy(), hits.within(range_m))


# ------------------------------------------------------------------------- fusion over the clip


class StaticMap:
    """Static surface points and free space of a clip, fused in the world frame."""

    def __init__(
        self, lower_m: Float[np.ndarray, "3"], upper_m: Float[np.ndarray, "3"], cell_m: float
    ) -> None:
        self.lower_m = np.asarray(lower_m, dtype=np.float64)
        self.cell_m = cell_m
        cells = np.ceil((np.asarray(upper_m) - self.lower_m) / cell_m).astype(int)
        self.free = np.zeros(cells, dtype=np.uint8)
        self._points: list[np.ndarray] = []
        self._classes: list[np.ndarray] = []

    def add(self, scan: Scan, range_m: float) -> None:
        """Free space along every ray, and a point where a ray met something static."""
        length_m = np.minimum(scan.hits.distance_m, range_m)
        carve(self.free, self.lower_m, self.cell_m, scan.origin_m, scan.directions, length_m)
        static = scan.hits.actor_id == 0
        self._points.append(scan.points_m(static))
        self._classes.append(scan.hits.class_id[static])

    def freeze(self) -> None:
        """Thins the points out and takes the cells that hold one from the free space."""
        points_m, class_id = np.concatenate(self._points), np.concatenate(self._classes)
        keep = _one_per_cube(points_m, class_id)
        self.points_m, self.class_id = points_m[keep], class_id[keep]
        cell = np.floor((self.points_m - self.lower_m) / self.cell_m).astype(int)
        cell = cell[((cell >= 0) & (cell < self.free.shape)).all(axis=1)]
        self.free[tuple(cell.T)] = 0

    def vote(
        self, votes: Int[np.ndarray, "X Y Z 8"], grid: VoxelGrid, world_from_occ: torch.Tensor
    ) -> None:
        """Crops the fused points to the grid of one frame."""
        _vote(votes, grid, world_from_occ, self.points_m, self.class_id)

    def free_at(self, points_m: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        """Whether some ray passed through the cell of each world point, and none ended there."""
        cell = np.floor((points_m - self.lower_m) / self.cell_m).astype(int)
        inside = ((cell >= 0) & (cell < self.free.shape)).all(axis=-1)
        cell = np.where(inside[..., None], cell, 0)
        return inside & (self.free[cell[..., 0], cell[..., 1], cell[..., 2]] == 1)


class ActorMap:
    """Surface points of every actor in its own frame, from all scans of the clip."""

    def __init__(self) -> None:
        self._points: dict[int, list[np.ndarray]] = defaultdict(list)

    def add(self, scan: Scan, bodies: Iterable[Body], step: int) -> None:
        for body in bodies:
            mine = scan.hits.actor_id == body.actor_id
            if mine.any():
                pose = body.world_from_actor[step]
                points_m = scan.points_m(mine) - pose[:3, 3]
                self._points[body.actor_id].append(points_m @ pose[:3, :3])

    def freeze(self) -> None:
        self.points_m = {}
        for actor_id, batches in self._points.items():
            points_m = np.concatenate(batches)
            keep = _one_per_cube(points_m, np.zeros(len(points_m), np.uint8))
            self.points_m[actor_id] = points_m[keep]

    def placed(self, body: Body, step: int) -> Float[np.ndarray, "n 3"]:
        """The actor's points in the world, where it is at a step."""
        points_m = self.points_m.get(body.actor_id, np.zeros((0, 3)))
        pose = body.world_from_actor[step]
        return points_m @ pose[:3, :3].T + pose[:3, 3]


def _one_per_cube(
    points_m: Float[np.ndarray, "n 3"], class_id: UInt8[np.ndarray, "n"]
) -> Int[np.ndarray, "k"]:
    """Indices of the first point of every class in every cube of FUSED_POINT_M."""
    cube = np.floor(points_m / FUSED_POINT_M).astype(np.int64)
    cube -= cube.min(axis=0, initial=0)
    span = cube.max(axis=0, initial=0) + 1
    key = ((cube[:, 0] * span[1] + cube[:, 1]) * span[2] + cube[:, 2]) * 256 + class_id
    return np.sort(np.unique(key, return_index=True)[1])


# ---------------------------------------------------------------------------- labels of a frame


@dataclass(frozen=True)
class Labels:
    """``semantics`` (255 where unsupervised), and what the front camera itself sees of it."""

    semantics: UInt8[np.ndarray, "X Y Z"]
    visible: Bool[np.ndarray, "X Y Z"]


def visible_pixels(view: View, actor_id: int) -> int:
    """The visible support V_{a,t} of App. A.3: pixels of the instance mask that show the actor."""
    return int((view.actor_id == actor_id).sum())


def label_frame(
    view: View,
    grid: VoxelGrid,
    static: StaticMap,
    actors: ActorMap,
    bodies: Iterable[Body],
    step: int,
    lidar_returns: dict[int, int],
) -> Labels:
    """The labels of one frame; ``lidar_returns`` counts the returns of now from every actor."""
    to_world = world_from_occ(view.world_from_body)
    centres = grid.centers(torch.float64).reshape(-1, 3)
    centres_m = transform(to_world, centres).numpy().reshape(*grid.shape, 3)
    frustum = Frustum.of(view, centres, grid)

    votes = np.zeros((*grid.shape, FREE), dtype=np.int32)
    static.vote(votes, grid, to_world)
    seen = _vote_camera(votes, view, grid, to_world)

    moving = np.zeros(grid.shape, dtype=bool)
    for body in bodies:
        near = reach_of(grid, to_world, body, step)
        if near is None:
            continue
        moving[near] |= in_box(centres_m[near], body, step, grid.voxel_m / 2)
        supported = visible_pixels(view, body.actor_id) >= MIN_VISIBLE_PIXELS
        if supported or lidar_returns.get(body.actor_id, 0) >= MIN_LIDAR_RETURNS:
            points_m = actors.placed(body, step)
            points_m = points_m[~sees_through(view, points_m, grid.voxel_m / 2)]
            class_id = np.full(len(points_m), body.class_id, np.uint8)
            _vote(votes, grid, to_world, points_m, class_id)

    free = (static.free_at(centres_m) & ~moving) | frustum.seen_free
    semantics = elect(votes, free)
    semantics[~frustum.inside] = UNKNOWN
    occupied = (semantics != UNKNOWN) & (semantics != FREE)
    visible = np.where(occupied, seen, (semantics == FREE) & frustum.seen_free)
    return Labels(semantics, visible)


def elect(
    votes: Int[np.ndarray, "X Y Z 8"], free: Bool[np.ndarray, "X Y Z"]
) -> UInt8[np.ndarray, "X Y Z"]:
    """The class with most points; a tie goes to the rarer class; occupied wins over free."""
    order = np.array(RAREST_FIRST, dtype=np.uint8)
    winner = order[votes[..., order].argmax(axis=-1)]
    return np.where(votes.any(axis=-1), winner, np.where(free, FREE, UNKNOWN)).astype(np.uint8)


@dataclass(frozen=True)
class Frustum:
    """Voxels whose centre is in the image, and those that the camera sees to be free now."""

    inside: Bool[np.ndarray, "X Y Z"]
    seen_free: Bool[np.ndarray, "X Y Z"]

    @classmethod
    def of(cls, view: View, centres_occ: torch.Tensor, grid: VoxelGrid) -> "Frustum":
        """Free is what lies nearer than the rendered depth by half a voxel's diagonal."""
        pix, depth_m = project(centres_occ, view.camera_from_occ, view.pix_from_camera)
        height, width = view.depth_m.shape
        inside = in_image(pix, depth_m, width, height)
        u, v = pix[inside].long().unbind(-1)
        surface_m = torch.from_numpy(view.depth_m)[v, u]
        seen_free = torch.zeros_like(inside)
        seen_free[inside] = depth_m[inside] < surface_m - grid.voxel_m * 3**0.5 / 2
        return cls(inside.numpy().reshape(grid.shape), seen_free.numpy().reshape(grid.shape))


def reach_of(
    grid: VoxelGrid, to_world: torch.Tensor, body: Body, step: int
) -> tuple[slice, slice, slice] | None:
    """The block of voxels that an actor can reach into; ``None`` where it is off the grid."""
    middle_m = body.world_from_actor[step][:3, 3] + [0, 0, body.size_m[2] / 2]
    middle = transform(inverse(to_world), torch.from_numpy(middle_m)[None])[0].numpy()
    reach_m = float(np.linalg.norm(body.size_m)) / 2 + grid.voxel_m
    low = np.floor((middle - reach_m - grid.lower_m) / grid.voxel_m).astype(int)
    high = np.ceil((middle + reach_m - grid.lower_m) / grid.voxel_m).astype(int)
    low, high = np.maximum(low, 0), np.minimum(high, grid.shape)
    return None if (low >= high).any() else tuple(slice(*pair) for pair in zip(low, high))


def in_box(
    points_m: Float[np.ndarray, "*n 3"], body: Body, step: int, margin_m: float
) -> Bool[np.ndarray, "*n"]:
    """Which world points lie in the actor's box, grown by a margin. It stands on its origin."""
    pose = body.world_from_actor[step]
    length_m, width_m, height_m = body.size_m
    points = (points_m - pose[:3, 3]) @ pose[:3, :3]
    return (
        (np.abs(points[..., 0]) <= length_m / 2 + margin_m)
        & (np.abs(points[..., 1]) <= width_m / 2 + margin_m)
        & (np.abs(points[..., 2] - height_m / 2) <= height_m / 2 + margin_m)
    )


def sees_through(
    view: View, points_m: Float[np.ndarray, "n 3"], tolerance_m: float
) -> Bool[np.ndarray, "n"]:
    """Depth consistency: world points at whose place the camera sees something farther behind.

    A surface there would hide what is behind it, so it cannot be there now. All pixels around the
    point's own must agree, because a silhouette falls between pixels.
    """
    occ_from_world = inverse(world_from_occ(view.world_from_body))
    points_occ = transform(occ_from_world, torch.from_numpy(points_m))
    pix, depth_m = project(points_occ, view.camera_from_occ, view.pix_from_camera)
    height, width = view.depth_m.shape
    inside = in_image(pix, depth_m, width, height).numpy()
    u, v = pix[inside].long().unbind(-1)
    nearest_m = np.full(len(u), np.inf, dtype=np.float32)
    for du in (-1, 0, 1):
        for dv in (-1, 0, 1):
            neighbour = view.depth_m[(v + dv).clamp(0, height - 1), (u + du).clamp(0, width - 1)]
            nearest_m = np.minimum(nearest_m, neighbour)
    through = np.zeros(len(points_m), dtype=bool)
    through[inside] = depth_m.numpy()[inside] < nearest_m - tolerance_m
    return through


def _vote_camera(
    votes: Int[np.ndarray, "X Y Z 8"], view: View, grid: VoxelGrid, to_world: torch.Tensor
) -> Bool[np.ndarray, "X Y Z"]:
    """Adds every pixel's point to the votes; returns the voxels that hold one."""
    rays = view.rays(stride=1, range_m=np.inf)
    hit = rays.hits.actor_id >= 0
    camera = np.zeros_like(votes)
    _vote(camera, grid, to_world, rays.points_m(hit), rays.hits.class_id[hit])
    votes += camera
    return camera.any(axis=-1)


def _vote(
    votes: Int[np.ndarray, "X Y Z 8"],
    grid: VoxelGrid,
    to_world: torch.Tensor,
    points_m: Float[np.ndarray, "n 3"],
    class_id: UInt8[np.ndarray, "n"],
) -> None:
    occ_from_world = inverse(to_world).numpy()
    count_votes(votes, np.array(grid.lower_m), grid.voxel_m, occ_from_world, points_m, class_id)
