"""The picture of how a frame is annotated (App. A.3), from the annotation's own arrays."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path

import matplotlib
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from matplotlib.colors import LogNorm
from PIL import Image, ImageOps

from src.geometry import in_image, inverse, project
from src.ontology import FREE, SKY, UNKNOWN
from src.report.canvas import Pixels, titled_sheet, write_picture
from src.report.top import render_top
from src.report.view import Frustum
from src.report.voxels import PALETTE, render_voxels, view_of
from src.sim.annotation import FrontView as View
from src.sim.annotation import elect, is_supported, vote_actors, vote_camera
from src.sim.clip_maker import ClipMaker, ClipPlan
from src.sim.observation import Observation
from src.sim.sensors import scan
from studies.world.shot import entropy

CELL_PIX = (560, 315)
MAX_BYTES = 900_000
DEPTH_M = (1.0, 80.0)
DOT_PIX = 3
NEAREST = Image.Resampling.NEAREST


def draw_pipeline(sim: Mapping, plan: ClipPlan, path: Path) -> None:
    """Write a JPEG: what was sensed in one frame of a clip, what the clip's scans say together, and
    the labels that come of it.

    The frame is the one whose pixels are spread most evenly over the classes; it is captured at the
    LiDARs' rate, at which the clips fuse too. Raises `UserError` for settings that cannot be made.
    """
    # More frames would take longer and fuse nothing more.
    rate_hz = min(sim["capture_hz"], sim["lidar_hz"])
    maker = ClipMaker({**sim, "capture_hz": rate_hz}, Path())
    images: list[Pixels] = []
    seen = maker.observe(plan, lambda frame, image, rendering: images.append(image))
    frame = int(np.argmax([entropy(view.class_id) for view in seen.views]))
    rows = [_sensed(maker, seen, frame, images[frame]), _labelled(maker, seen, frame)]
    write_picture(titled_sheet(rows, CELL_PIX[0]).drawn(), path, MAX_BYTES)


# ---------------------------------------------------------------------------------- what is sensed


def _sensed(
    maker: ClipMaker, seen: Observation, frame: int, image: Pixels
) -> list[tuple[str, Pixels]]:
    view = seen.views[frame]
    pictures = {
        "1  front image": image,
        "2  depth, 1 to 80 m": _depth(view),
        "3  semantics": _classes(view),
        "4  instances of moving actors": _instances(view),
        "5  returns of both LiDARs, by range": _returns(maker, seen, frame, image),
    }
    return [(title, _shaped(picture)) for title, picture in pictures.items()]


def _depth(view: View) -> Pixels:
    return np.where(np.isinf(view.depth_m)[..., None], np.uint8(255), _by_range(view.depth_m))


def _by_range(distance_m: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n 3"]:
    share = LogNorm(*DEPTH_M, clip=True)(np.minimum(distance_m, DEPTH_M[1]))
    return matplotlib.colormaps["turbo_r"](share, bytes=True)[..., :3]


def _classes(view: View) -> Pixels:
    colors = np.append(PALETTE, [[255, 255, 255]], axis=0).astype(np.uint8)
    return colors[np.where(view.class_id == SKY, len(PALETTE), view.class_id)]


def _instances(view: View) -> Pixels:
    """Every actor in a color of its own, all else pale."""
    hues = matplotlib.colormaps["tab20"](view.actor_id % 20, bytes=True)[..., :3]
    pale = (0.25 * _classes(view) + 0.75 * 255).astype(np.uint8)
    return np.where((view.actor_id > 0)[..., None], hues, pale)


def _returns(maker: ClipMaker, seen: Observation, frame: int, image: Pixels) -> Pixels:
    """The LiDAR returns of the frame's own scan that lie in the image, over it."""
    view, sim = seen.views[frame], maker.sim
    world_from_body, step = view.world_from_body.numpy(), maker.step_of(frame)
    scans = scan(
        seen.recording.scene, step, world_from_body, sim["lidar_rays"], frame, maker.range_m
    )
    points_m = np.concatenate([each.points_m(each.hits.actor_id >= 0) for each in scans])
    height, width = view.depth_m.shape
    camera_from_world = inverse(view.world_from_body @ view.body_from_camera)
    pix, depth_m = project(torch.from_numpy(points_m), camera_from_world, view.pix_from_camera)
    inside = in_image(pix, depth_m, width, height)
    scale = CELL_PIX[0] / width
    picture = (0.35 * _scaled(image) + 0.65 * 255).astype(np.uint8)
    # Far points first, so that near ones are drawn over them.
    order = torch.argsort(depth_m[inside], descending=True)
    column, row = (pix[inside][order] * scale).long().numpy().T
    colors = _by_range(depth_m[inside][order].numpy())

    for right, down in product(range(DOT_PIX), repeat=2):
        v = np.minimum(row + down, picture.shape[0] - 1)
        picture[v, np.minimum(column + right, picture.shape[1] - 1)] = colors
    return picture


# --------------------------------------------------------------------------------- what is labelled


def _labelled(maker: ClipMaker, seen: Observation, frame: int) -> list[tuple[str, Pixels]]:
    view, grid = seen.views[frame], maker.grid
    fused = _elected(_static_votes(maker, seen, view))
    # App. A.3: static surfaces are fused over time, actors are placed as they are now.
    placed = _elected(_all_votes(maker, seen, frame))
    labels = maker.label(seen, frame)
    final = labels.semantics
    visible = np.where(labels.visible, final, np.uint8(UNKNOWN))
    meta = (view.camera_from_occ, view.pix_from_camera, view.depth_m.shape[::-1])
    frustum, point_of_view = Frustum(*meta), view_of([fused, placed], grid, CELL_PIX)

    def voxels(semantics: UInt8[np.ndarray, "X Y Z"]) -> Pixels:
        return render_voxels(semantics, grid, CELL_PIX, point_of_view, frustum)

    return [
        ("6  static surfaces, fused over the clip", voxels(fused)),
        ("7  and actors, fused, where they are now", voxels(placed)),
        ("8  labels: majority of each voxel in the image", voxels(final)),
        ("9  from above, with free space", render_top(final, grid, CELL_PIX)),
        ("10  of these, visible to the camera now", voxels(visible)),
    ]


def _static_votes(maker: ClipMaker, seen: Observation, view: View) -> Int[np.ndarray, "X Y Z 8"]:
    votes = np.zeros((*maker.grid.shape, FREE), dtype=np.int32)
    seen.static.vote(votes, maker.grid, view.occ_from_world)
    return votes


def _all_votes(maker: ClipMaker, seen: Observation, frame: int) -> Int[np.ndarray, "X Y Z 8"]:
    """Votes for all surfaces that any signal speaks for, in the image or not."""
    view, returns = seen.views[frame], seen.lidar_returns[frame]
    votes = _static_votes(maker, seen, view) + vote_camera(view, maker.grid)
    supported = [body for body in seen.recording.actors if is_supported(body, view, returns)]
    vote_actors(votes, view, maker.grid, seen.actors, supported, maker.step_of(frame))
    return votes


def _elected(votes: Int[np.ndarray, "X Y Z 8"]) -> UInt8[np.ndarray, "X Y Z"]:
    """The surfaces alone: what nobody votes for is unknown, not free."""
    return elect(votes, np.zeros(votes.shape[:3], dtype=bool))


def _scaled(picture: Pixels) -> Pixels:
    height = round(CELL_PIX[0] * picture.shape[0] / picture.shape[1])
    return np.asarray(Image.fromarray(picture).resize((CELL_PIX[0], height), NEAREST))


def _shaped(picture: Pixels) -> Pixels:
    """A picture as wide as a cell: its middle where it is higher, on white where it is lower."""
    image = Image.fromarray(picture)
    is_higher = image.height * CELL_PIX[0] >= image.width * CELL_PIX[1]
    shaped = ImageOps.fit if is_higher else partial(ImageOps.pad, color="white")
    return np.asarray(shaped(image, CELL_PIX, NEAREST))
