"""The chain of App. A.3 from sensor signals to the labels of a frame, one function a stage.

`fusion` joins the scans of a clip. A frame is labelled in its occ frame, through the projection
chain of `geometry` alone.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch.nn.functional import max_pool2d

from .. import geometry
from ..geometry import VoxelGrid
from ..ontology import FREE, UNKNOWN
from .fusion import ActorMap, StaticMap
from .scene import ScanHits, SceneActor, count_by_actor
from .sensors import Scan
from .voxel_kernels import Lattice, centers_of, count_votes, elect, see_centers

# An actor is placed where it is now if the camera or the LiDARs see at least this of it now.
MIN_VISIBLE_PIXELS = 4
MIN_LIDAR_RETURNS = 3


@dataclass(frozen=True)
class FrontView:
    """The front camera's transforms and images at one frame. Matrices are float64 tensors."""

    world_from_body: torch.Tensor
    body_from_camera: torch.Tensor
    pix_from_camera: torch.Tensor
    depth_m: Float[np.ndarray, "h w"]
    class_id: UInt8[np.ndarray, "h w"]
    actor_id: Int[np.ndarray, "h w"]

    @cached_property
    def camera_from_occ(self) -> torch.Tensor:
        return geometry.camera_from_occ(self.world_from_body, self.body_from_camera)

    @cached_property
    def world_from_occ(self) -> Float[np.ndarray, "4 4"]:
        return geometry.world_from_occ(self.world_from_body).numpy()

    @cached_property
    def occ_from_world(self) -> Float[np.ndarray, "4 4"]:
        return geometry.inverse(self.world_from_occ)

    @cached_property
    def visible_pixels(self) -> dict[int, int]:
        """The visible support V_{a,t} of App. A.3: pixels of the instance mask, by actor."""
        return count_by_actor(self.actor_id)

    def rays(self, stride: int, range_m: float) -> Scan:
        """Returns every ``stride``-th pixel as a ray in the world.

        A ray whose pixel lies beyond the range meets nothing.
        """
        every = slice(stride // 2, None, stride)
        height, width = self.depth_m.shape
        pix = geometry.pixel_centers(width, height)[every, every].reshape(-1, 2)
        images = self.depth_m, self.class_id, self.actor_id
        depth_m, class_id, actor_id = (image[every, every].reshape(-1) for image in images)

        # Places at a depth of 1 m: their distance turns a z-depth into the length of the ray.
        through = geometry.unproject(pix, torch.ones_like(pix[:, 0]), self.pix_from_camera)
        reach = through.norm(dim=-1)
        world_from_camera = self.world_from_body @ self.body_from_camera
        directions = geometry.rotate(world_from_camera, through / reach[:, None])
        hits = ScanHits(depth_m * reach.numpy(), class_id, actor_id)
        return Scan(world_from_camera[:3, 3].numpy(), directions.numpy(), hits.within(range_m))


@dataclass(frozen=True)
class Labels:
    """``semantics`` (255 where unsupervised), and the part that the front camera itself sees."""

    semantics: UInt8[np.ndarray, "X Y Z"]
    visible: Bool[np.ndarray, "X Y Z"]


def label_frame(
    view: FrontView,
    grid: VoxelGrid,
    static_map: StaticMap,
    actor_map: ActorMap,
    actors: Iterable[SceneActor],
    step: int,
    lidar_returns: Mapping[int, int],
) -> Labels:
    """Returns the labels of one frame.

    ``lidar_returns`` counts the returns of the frame's own scan from every actor.
    """
    # Every point that a sensor measured votes for its class in the voxel around it.
    inside, seen_free = frustum(view, grid)
    votes = vote_camera(view, grid)
    seen = votes.any(axis=-1)
    static_map.vote(votes, grid, view.occ_from_world)
    supported = [actor for actor in actors if is_supported(actor, view, lidar_returns)]
    vote_actors(votes, view, grid, actor_map, supported, step)

    # Free space of earlier and later scans does not hold where a moving actor stands now.
    moving = space_of(actors, step, view, grid)
    free = (static_map.free_in(grid, view.world_from_occ) & ~moving) | seen_free
    semantics = np.where(inside, elect(votes, free), np.uint8(UNKNOWN))

    # Of the surfaces the camera sees those that hold a pixel's point, of the air what is before it.
    visible = ((semantics < FREE) & seen) | ((semantics == FREE) & seen_free)
    return Labels(semantics, visible)


# --------------------------------------------------------------------------- frustum and free space


def frustum(
    view: FrontView, grid: VoxelGrid
) -> tuple[Bool[np.ndarray, "X Y Z"], Bool[np.ndarray, "X Y Z"]]:
    """Returns the voxels whose center is in the image, and those that the camera sees to be free.

    A voxel is seen to be free if it is nearer than the rendered depth by half its diagonal.
    """
    pix_from_occ = (view.pix_from_camera @ view.camera_from_occ[:3]).numpy()
    clearance_m = grid.voxel_m * 3**0.5 / 2
    return see_centers(grid.shape, Lattice.of(grid), pix_from_occ, view.depth_m, clearance_m)


def space_of(
    actors: Iterable[SceneActor], step: int, view: FrontView, grid: VoxelGrid
) -> Bool[np.ndarray, "X Y Z"]:
    """Returns the voxels in the boxes of moving actors as they stand at a step."""
    moving, axes_m = np.zeros(grid.shape, dtype=bool), centers_of(grid)
    for actor in actors:
        half_m = np.array(actor.size_m) / 2 + grid.voxel_m / 2
        # An actor stands on its origin; its box is around its middle.
        occ_from_box = view.occ_from_world @ actor.world_from_actor[step]
        middle_m = occ_from_box[:3, 3] + (0, 0, actor.size_m[2] / 2)

        # However it is turned, the box reaches no farther than this along each axis.
        flat_m = np.hypot(half_m[0], half_m[1])
        reach_m = (flat_m, flat_m, half_m[2])
        near = [np.abs(axes_m[k] - middle_m[k]).ravel() <= reach_m[k] for k in range(3)]
        away_m = [axes_m[k].ravel()[near[k]] - middle_m[k] for k in range(3)]
        away_m = np.stack(np.meshgrid(*away_m, indexing="ij"), axis=-1)
        moving[np.ix_(*near)] |= (np.abs(away_m @ occ_from_box[:3, :3]) <= half_m).all(axis=-1)
    return moving


# -------------------------------------------------------------------------------------- the vote


def vote_camera(view: FrontView, grid: VoxelGrid) -> Int[np.ndarray, "X Y Z 8"]:
    """Returns the votes of the points that the pixels show."""
    occ_from_pix = geometry.inverse(view.camera_from_occ)[:3]
    occ_from_pix[:, :3] = occ_from_pix[:, :3] @ torch.linalg.inv(view.pix_from_camera)
    to_u, to_v, to_one, origin_m = occ_from_pix.numpy().T

    # A pixel whose class is not known hides what is behind it, and votes for nothing.
    row, column = np.nonzero(np.isfinite(view.depth_m) & (view.class_id < FREE))
    u, v, depth_m = column[:, None] + 0.5, row[:, None] + 0.5, view.depth_m[row, column, None]
    points_m = origin_m + depth_m * (to_u * u + to_v * v + to_one)
    votes = np.zeros((*grid.shape, FREE), dtype=np.int32)
    count_votes(votes, Lattice.of(grid), np.eye(4), points_m, view.class_id[row, column])
    return votes


def is_supported(actor: SceneActor, view: FrontView, lidar_returns: Mapping[int, int]) -> bool:
    """Returns whether the camera or the LiDARs see enough of an actor now to place it."""
    pixels = view.visible_pixels.get(actor.actor_id, 0)
    returns = lidar_returns.get(actor.actor_id, 0)
    return pixels >= MIN_VISIBLE_PIXELS or returns >= MIN_LIDAR_RETURNS


def vote_actors(
    votes: Int[np.ndarray, "X Y Z 8"],
    view: FrontView,
    grid: VoxelGrid,
    actor_map: ActorMap,
    actors: Iterable[SceneActor],
    step: int,
) -> None:
    """Adds the actors' fused points, placed where each is now, but for those looked through."""
    points_m, class_id = np.zeros((0, 3)), np.zeros(0, dtype=np.uint8)
    for actor in actors:
        placed_m = actor_map.placed(actor, step)
        points_m = np.concatenate([points_m, placed_m])
        class_id = np.append(class_id, np.full(len(placed_m), actor.class_id, np.uint8))

    kept = ~sees_through(view, points_m, grid.voxel_m / 2)
    count_votes(votes, Lattice.of(grid), view.occ_from_world, points_m[kept], class_id[kept])


def sees_through(
    view: FrontView, points_m: Float[np.ndarray, "n 3"], tolerance_m: float
) -> Bool[np.ndarray, "n"]:
    """Finds world points at whose place the camera sees something farther behind (depth
    consistency).

    A surface there would hide what is behind it, so it cannot be there now.
    """
    points_occ = torch.from_numpy(geometry.transform(view.occ_from_world, points_m))
    pix, depth_m = geometry.project(points_occ, view.camera_from_occ, view.pix_from_camera)
    height, width = view.depth_m.shape
    inside = geometry.in_image(pix, depth_m, width, height).numpy()

    # All pixels around the point's own must agree, because a silhouette falls between pixels.
    nearest_m = -max_pool2d(-torch.from_numpy(view.depth_m)[None], 3, stride=1, padding=1)[0]
    column, row = pix[inside].long().numpy().T
    through = np.zeros(len(points_m), dtype=bool)
    through[inside] = depth_m.numpy()[inside] < nearest_m.numpy()[row, column] - tolerance_m
    return through
