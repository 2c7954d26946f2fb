"""Semantic voxels as a shaded 3-D picture, seen from behind and above the UAV."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from PIL import Image, ImageDraw

from ..errors import UserError
from ..geometry import VoxelGrid, pixel_centers
from ..ontology import CLASSES, COLORS, FREE
from ..voxels import rays_in_grid
from .canvas import Pixels
from .overlay import FRUSTUM_COLOR, Pen, draw_floor, draw_uav
from .raycast import PixelHits, cast
from .view import FRUSTUM_SHARE, Frustum, Labels, PlaceM, SizePix, place_behind

SUPERSAMPLING = 2

# sRGB of every class, by its id.
PALETTE = np.array([COLORS[name] for name in CLASSES], dtype=np.float32)

# Towards the sun in the occ frame: behind the UAV and to its left, so that most of what one sees is
# lit, and shadows fall forward and to the right.
SUN = np.array([-0.42, 0.52, 0.95])
SKY_LIGHT, SUN_LIGHT = 0.76, 0.44
SHARE_IN_CORNERS = 0.55
# The light of the sky on a face by `openness`: in a corner, and in the open.
IN_CORNER, IN_OPEN = 8, 17
EDGE_DARKENING, EDGE_PIX = 0.28, 0.55
FLOOR_COLOR = np.array([246.0, 248.0, 250.0], dtype=np.float32)

# Of labels over an image: how much of a pixel is its voxel's color, and how much darker edges are.
COLOR_SHARE, EDGE_SHARE = 0.6, 0.35

# How far the far end of the grid fades to white.
HAZE = 0.28


def ground_level(labels: Labels, grid: VoxelGrid) -> float:
    """Height in metres (occ) of the bottom of the lowest occupied voxel, or of an empty grid."""
    layers = np.flatnonzero((labels < FREE).any(axis=(0, 1)))
    return grid.lower_m[2] + grid.voxel_m * (int(layers[0]) if len(layers) else 0)


def view_of(scenes: Sequence[Labels], grid: VoxelGrid, size_pix: SizePix) -> PlaceM:
    """From behind and above the UAV, with every occupied voxel of the scenes in the picture.

    The UAV and the ground under it are in it too; an empty scene shows its footprint.
    """
    occupied = np.any([labels < FREE for labels in scenes], axis=0)
    floor_m = min(ground_level(labels, grid) for labels in scenes)
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, floor_m]]
    if not occupied.any():
        (x0, y0, _), (x1, y1, _) = grid.lower_m, grid.upper_m
        points += [[x, y, floor_m] for x in (x0, x1) for y in (y0, y1)]
    centers = grid.centers(torch.float64)[torch.from_numpy(occupied)]
    shown = torch.cat([torch.tensor(points, dtype=torch.float64), centers])
    return place_behind(shown, size_pix[0] / size_pix[1])


def render_voxels(
    labels: Labels,
    grid: VoxelGrid,
    size_pix: SizePix,
    view: PlaceM | None = None,
    frustum: Frustum | None = None,
    floor_m: float | None = None,
    frustum_share: float = FRUSTUM_SHARE,
) -> Pixels:
    """Picture, width x height ``size_pix``, of the occupied voxels in their class colors.

    Free and unknown voxels are not drawn. Under them lies the footprint of the grid with a line
    every 10 m, at ``floor_m`` (by default under the lowest occupied voxel; give two pictures the
    same one to compare them). The UAV is drawn at the origin with its plumb line and, if given, its
    camera's ``frustum``, as deep as a share of the grid's length. Left in the picture is the UAV's
    left, +y. The default view is `view_of` these labels alone. Raises `UserError` where the labels
    do not have the grid's shape.
    """
    check_labels(labels, grid)
    view = view or view_of([labels], grid, size_pix)
    floor_m = ground_level(labels, grid) if floor_m is None else floor_m
    width, height = size_pix[0] * SUPERSAMPLING, size_pix[1] * SUPERSAMPLING
    camera = Frustum.observer(view, (width, height))
    hits = cast_pixels(labels, grid, camera, floor_m)

    rgb = _shade(labels, grid, hits, float(camera.pix_from_camera[0, 0]), view[0])
    image = Image.fromarray(rgb.reshape(height, width, 3))

    # Lines keep their share of the picture at any size.
    line_pix = max(1, round(width / 500))
    seen_m = hits.distance.reshape(height, width)
    pen = Pen(ImageDraw.Draw(image), seen_m, camera, tolerance_m=0.3 * grid.voxel_m)
    draw_floor(pen, grid, floor_m, line_pix)
    if frustum is not None:
        depth_m = frustum_share * (grid.upper_m[0] - grid.lower_m[0])
        for start, end in pairwise(frustum.outline(depth_m)):
            pen.line(start, end, FRUSTUM_COLOR, line_pix + 1)
    draw_uav(pen, grid, floor_m, line_pix + 1)

    return np.asarray(image.reduce(SUPERSAMPLING))


def openness(solid: Bool[np.ndarray, "X Y Z"]) -> UInt8[np.ndarray, "X+2 Y+2 Z+2"]:
    """Returns how many of the 3 x 3 x 3 voxels around each voxel are not solid.

    The result has a border of one voxel, so that the index of a neighbor plus one fits it.
    """
    count = np.pad(solid, 2).astype(np.uint8)
    for axis in range(3):
        count = sum(np.roll(count, step, axis) for step in (-1, 0, 1))
    return 27 - count[1:-1, 1:-1, 1:-1]


def check_labels(labels: np.ndarray, grid: VoxelGrid) -> None:
    """Raise `UserError` unless the labels have the grid's shape."""
    if labels.shape != grid.shape:
        raise UserError(
            f"labels of shape {list(labels.shape)} do not fit grid.shape {list(grid.shape)}; "
            "draw them with the grid that they were made with"
        )


def cast_pixels(
    labels: Labels, grid: VoxelGrid, camera: Frustum, floor_m: float = -np.inf
) -> PixelHits:
    """Returns the first hit of the ray through each pixel's center: a voxel, or the floor.

    The rays have unit z-depth: a hit's distance is its z-depth in metres.
    """
    pix = pixel_centers(*camera.size_pix).reshape(-1, 2)
    origin, rays = rays_in_grid(pix, camera.camera_from_occ, camera.pix_from_camera, grid)
    floor = (floor_m - grid.lower_m[2]) / grid.voxel_m
    return cast(labels < FREE, origin.numpy(), rays.contiguous().numpy(), SUN, floor)


def labels_in_image(image: Pixels, labels: Labels, grid: VoxelGrid, camera: Frustum) -> Pixels:
    """The image, every pixel tinted by the first occupied voxel on its ray, edges darker.

    The ray is the one through the pixel's center. With another ``camera`` than the one that took
    the image, colors stand beside their objects.
    """
    hits = cast_pixels(labels, grid, camera)
    met = hits.on_voxel
    # An edge is a pixel wide, however far away it is.
    pixel = hits.distance[met] / float(camera.pix_from_camera[0, 0]) / grid.voxel_m
    edge = EDGE_SHARE * (hits.edge[met] < pixel)
    color = PALETTE[labels[tuple(hits.voxel[met].T)]] * (1 - edge)[:, None]

    tinted = image.reshape(-1, 3).astype(np.float32)
    tinted[met] += COLOR_SHARE * (color - tinted[met])
    return np.rint(tinted).astype(np.uint8).reshape(image.shape)


def _shade(
    labels: Labels, grid: VoxelGrid, hits: PixelHits, focal_pix: float, observer_m: float
) -> UInt8[np.ndarray, "n 3"]:
    """Color of every ray: class color x light x edge, fading with distance; white for a miss."""
    rgb = np.full((len(hits.voxel), 3), 255.0, dtype=np.float32)
    rgb[hits.on_floor] = FLOOR_COLOR * np.where(hits.sunlit[hits.on_floor], 1.0, 0.90)[:, None]
    face = PixelHits(*(field[hits.on_voxel] for field in hits))

    # Sky and sun: how open the space before the face is, the orientation, the shadows.
    before = tuple((face.voxel + face.normal + 1).T)
    is_open = np.interp(openness(labels < FREE)[before], (IN_CORNER, IN_OPEN), (0, 1))
    light = SKY_LIGHT * (SHARE_IN_CORNERS + (1 - SHARE_IN_CORNERS) * is_open)
    light += SUN_LIGHT * (face.normal @ SUN) / np.linalg.norm(SUN) * face.sunlit
    # The edges of faces are dark, as thin as a pixel; none where voxels get tiny.
    pix_per_voxel = focal_pix * grid.voxel_m / face.distance
    on_edge = face.edge * pix_per_voxel < EDGE_PIX * SUPERSAMPLING
    strength = np.clip((pix_per_voxel / SUPERSAMPLING - 2) / 8, 0, 1)
    brightness = light * (1 - EDGE_DARKENING * strength * on_edge)

    color = np.minimum(PALETTE[labels[tuple(face.voxel.T)]] * brightness[:, None], 255)
    # Haze begins where the grid does, and is thickest at its far end.
    length_m = grid.upper_m[0] - grid.lower_m[0]
    haze = HAZE * np.clip((face.distance - (grid.lower_m[0] - observer_m)) / length_m, 0, 1)
    rgb[hits.on_voxel] = color + (255 - color) * haze[:, None]
    return rgb.round().astype(np.uint8)
