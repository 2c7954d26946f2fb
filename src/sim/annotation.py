"""From sensor signals to the labels of a frame: the chain of App. A.3, one function a stage.

What the scans of a clip say together comes from `fusion`. A frame is labelled in its occ frame,
through the projection chain of `geometry` alone.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import (
    VoxelGrid,
    camera_from_occ,
    in_image,
    inverse,
    pixel_centers,
    project,
    rotate,
    transform,
    unproject,
    world_from_occ,
)
from ..ontology import FREE
from .fusion import ActorMap, StaticMap
from .scene import Body, Hits
from .sensors import Scan
from .voxel_kernels import (
    count_pixel_votes,
    count_votes,
    elect_classes,
    least_of_neighbours,
    mark_box,
    see_centres,
    settle,
)

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

    @cached_property
    def camera_from_occ(self) -> torch.Tensor:
        return camera_from_occ(self.world_from_body, self.body_from_camera)

    @cached_property
    def world_from_occ(self) -> Float[np.ndarray, "4 4"]:
        return world_from_occ(self.world_from_body).numpy()

    @cached_property
    def occ_from_world(self) -> Float[np.ndarray, "4 4"]:
        return inverse(world_from_occ(self.world_from_body)).numpy()

    @cached_property
    def visible_pixels(self) -> dict[int, int]:
        """The visible support V_{a,t} of App. A.3: pixels of the instance mask, by actor."""
        ids, counts = np.unique(self.actor_id, return_counts=True)
        return {int(actor): int(count) for actor, count in zip(ids, counts) if actor > 0}

    def rays(self, stride: int, range_m: float) -> Scan:
        """Every ``stride``-th pixel as a ray in the world; what is beyond the range is not hit."""
        rows, columns = slice(stride // 2, None, stride), slice(stride // 2, None, stride)
        height, width = self.depth_m.shape
        pix = pixel_centers(width, height)[rows, columns].reshape(-1, 2)
        ones = torch.ones(len(pix), dtype=torch.float64)
        through = unproject(pix, ones, self.pix_from_camera)
        reach = through.norm(dim=-1)
        world_from_camera = self.world_from_body @ self.body_from_camera
        directions = rotate(world_from_camera, through / reach[:, None])
        depth_m = self.depth_m[rows, columns].reshape(-1)
        hits = Hits(
            depth_m * reach.numpy(),
            self.class_id[rows, columns].reshape(-1),
            self.actor_id[rows, columns].reshape(-1),
        )
        return Scan(world_from_camera[:3, 3].numpy(), directions.numpy(), hits.within(range_m))


@dataclass(frozen=True)
class Labels:
    """``semantics`` (255 where unsupervised), and what the front camera itself sees of it."""

    semantics: UInt8[np.ndarray, "X Y Z"]
    visible: Bool[np.ndarray, "X Y Z"]


def label_frame(
    view: View,
    grid: VoxelGrid,
    static: StaticMap,
    actors: ActorMap,
    bodies: Iterable[Body],
    step: int,
    lidar_returns: Mapping[int, int],
) -> Labels:
    """The labels of one frame; ``lidar_returns`` counts the returns of now from every actor."""
    frustum = Frustum.of(view, grid)
    votes = np.zeros((*grid.shape, FREE), dtype=np.int32)
    static.vote(votes, grid, view.occ_from_world)
    seen = vote_camera(votes, view, grid)
    supported = [body for body in bodies if is_supported(body, view, lidar_returns)]
    vote_actors(votes, view, grid, actors, supported, step)

    moving = space_of(bodies, step, view, grid)
    free = (static.free_in(grid, view.world_from_occ) & ~moving) | frustum.seen_free
    semantics, visible = elect(votes, free), np.empty(grid.shape, dtype=bool)
    marks = (visible, frustum.inside, seen, frustum.seen_free)
    settle(semantics.ravel(), *(mark.ravel() for mark in marks))
    return Labels(semantics, visible)


# --------------------------------------------------------------------------- frustum and free space


@dataclass(frozen=True)
class Frustum:
    """Voxels whose centre is in the image, and those that the camera sees to be free now."""

    inside: Bool[np.ndarray, "X Y Z"]
    seen_free: Bool[np.ndarray, "X Y Z"]

    @classmethod
    def of(cls, view: View, grid: VoxelGrid) -> "Frustum":
        """Free is what lies nearer than the rendered depth by half a voxel's diagonal."""
        inside, seen_free = np.zeros((2, *grid.shape), dtype=bool)
        pix_from_occ = (view.pix_from_camera @ view.camera_from_occ[:3]).numpy()
        clearance_m = grid.voxel_m * 3**0.5 / 2
        see_centres(inside, seen_free, *_place(grid), pix_from_occ, view.depth_m, clearance_m)
        return cls(inside, seen_free)


def space_of(
    bodies: Iterable[Body], step: int, view: View, grid: VoxelGrid
) -> Bool[np.ndarray, "X Y Z"]:
    """Voxels in the boxes of moving actors as they stand now: what was free there no longer is."""
    moving = np.zeros(grid.shape, dtype=bool)
    for body in bodies:
        half_m = np.array(body.size_m) / 2 + grid.voxel_m / 2
        # An actor stands on its origin; its box is around its middle.
        occ_from_box = view.occ_from_world @ body.world_from_actor[step]
        occ_from_box[2, 3] += body.size_m[2] / 2
        mark_box(moving, *_place(grid), occ_from_box, half_m)
    return moving


# -------------------------------------------------------------------------------------- the vote


def vote_camera(
    votes: Int[np.ndarray, "X Y Z 8"], view: View, grid: VoxelGrid
) -> Bool[np.ndarray, "X Y Z"]:
    """Adds every pixel's point to the votes; returns the voxels that hold one."""
    seen = np.zeros(grid.shape, dtype=bool)
    occ_from_pix = inverse(view.camera_from_occ)[:3]
    occ_from_pix[:, :3] = occ_from_pix[:, :3] @ torch.linalg.inv(view.pix_from_camera)
    place = _place(grid)
    count_pixel_votes(votes, seen, *place, occ_from_pix.numpy(), view.depth_m, view.class_id)
    return seen


def is_supported(body: Body, view: View, lidar_returns: Mapping[int, int]) -> bool:
    """Whether the camera or the LiDARs see enough of an actor now to place it."""
    pixels = view.visible_pixels.get(body.actor_id, 0)
    returns = lidar_returns.get(body.actor_id, 0)
    return pixels >= MIN_VISIBLE_PIXELS or returns >= MIN_LIDAR_RETURNS


def vote_actors(
    votes: Int[np.ndarray, "X Y Z 8"],
    view: View,
    grid: VoxelGrid,
    actors: ActorMap,
    bodies: Iterable[Body],
    step: int,
) -> None:
    """Adds the actors' fused points, placed where each is now, but for those looked through."""
    placed = [(actors.placed(body, step), body.class_id) for body in bodies]
    points_m = np.concatenate([np.zeros((0, 3)), *(points for points, _ in placed)])
    class_id = np.repeat(
        np.array([class_id for _, class_id in placed], dtype=np.uint8),
        [len(points) for points, _ in placed],
    )
    kept = ~sees_through(view, points_m, grid.voxel_m / 2)
    count_votes(votes, *_place(grid), view.occ_from_world, points_m[kept], class_id[kept])


def sees_through(
    view: View, points_m: Float[np.ndarray, "n 3"], tolerance_m: float
) -> Bool[np.ndarray, "n"]:
    """Depth consistency: world points at whose place the camera sees something farther behind.

    A surface there would hide what is behind it, so it cannot be there now. All pixels around the
    point's own must agree, because a silhouette falls between pixels.
    """
    points_occ = transform(torch.from_numpy(view.occ_from_world), torch.from_numpy(points_m))
    pix, depth_m = project(points_occ, view.camera_from_occ, view.pix_from_camera)
    height, width = view.depth_m.shape
    inside = in_image(pix, depth_m, width, height).numpy()
    nearest_m = np.empty_like(view.depth_m)
    least_of_neighbours(nearest_m, view.depth_m)
    column, row = pix[inside].long().numpy().T
    through = np.zeros(len(points_m), dtype=bool)
    through[inside] = depth_m.numpy()[inside] < nearest_m[row, column] - tolerance_m
    return through


def elect(
    votes: Int[np.ndarray, "X Y Z 8"], free: Bool[np.ndarray, "X Y Z"]
) -> UInt8[np.ndarray, "X Y Z"]:
    """The class with most points; a tie goes to the rarer class; occupied wins over free."""
    semantics = np.empty(free.shape, dtype=np.uint8)
    elect_classes(semantics, votes, free)
    return semantics


def _place(grid: VoxelGrid) -> tuple[Float[np.ndarray, "3"], float]:
    return np.array(grid.lower_m, dtype=np.float64), grid.voxel_m
