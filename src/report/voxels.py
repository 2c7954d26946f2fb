"""Semantic voxels as a shaded 3-D picture, seen from behind and above the UAV."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from ..errors import UserError
from ..geometry import VoxelGrid, pixel_centers
from ..ontology import CLASSES, COLORS, FREE
from ..voxels import rays_in_grid
from .overlay import FRUSTUM_SHARE, Pen, draw_floor, draw_frustum, draw_uav
from .raycast import FLOOR, VOXEL, PixelHits, cast
from .view import Frustum, Viewpoint

SUPERSAMPLING = 2

# sRGB of every class, by its id.
PALETTE = np.array([COLORS[name] for name in CLASSES], dtype=np.float32)

# Towards the sun in the occ frame: behind the UAV and to its left, so that most of what one sees is
# lit, and shadows fall forward and to the right.
SUN = np.array([-0.42, 0.52, 0.95])
SKY_LIGHT, SUN_LIGHT = 0.76, 0.44
SHARE_IN_CORNERS = 0.55
EDGE_DARKENING, EDGE_PIX = 0.28, 0.55
FLOOR_COLOR = np.array([246.0, 248.0, 250.0], dtype=np.float32)

# What the far end of the grid fades to, and how far.
HAZE_COLOR, HAZE = np.array([255.0, 255.0, 255.0], dtype=np.float32), 0.28


def ground_level(labels: UInt8[np.ndarray, "X Y Z"], grid: VoxelGrid) -> float:
    """Height in metres (occ) of the bottom of the lowest occupied voxel, or of an empty grid."""
    layers = np.flatnonzero((labels < FREE).any(axis=(0, 1)))
    return grid.lower_m[2] + grid.voxel_m * (int(layers[0]) if len(layers) else 0)


def view_of(
    scenes: Sequence[UInt8[np.ndarray, "X Y Z"]], grid: VoxelGrid, size_pix: tuple[int, int]
) -> Viewpoint:
    """From behind and above the UAV, with every occupied voxel of the scenes in the picture.

    The UAV and the ground under it are in it too; an empty scene shows its footprint.
    """
    occupied = np.any([labels < FREE for labels in scenes], axis=0)
    (x0, y0, _), (x1, y1, _) = grid.lower_m, grid.upper_m
    floor_m = min(ground_level(labels, grid) for labels in scenes)
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, floor_m]]
    if not occupied.any():
        points += [[x, y, floor_m] for x in (x0, x1) for y in (y0, y1)]
    points = torch.tensor(points, dtype=torch.float64)
    centers = grid.centers(torch.float64)[torch.from_numpy(occupied)]

    return Viewpoint.behind(torch.cat([points, centers]), size_pix[0] / size_pix[1])


def render_voxels(
    labels: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    size_pix: tuple[int, int] = (800, 600),
    view: Viewpoint | None = None,
    frustum: Frustum | None = None,
    floor_m: float | None = None,
    frustum_share: float = FRUSTUM_SHARE,
) -> UInt8[np.ndarray, "h w 3"]:
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
    camera = view.camera((width, height))
    hits = cast_pixels(labels, grid, camera, floor_m)

    # Haze begins where the grid does.
    near_m = grid.lower_m[0] - view.position_m[0]
    rgb = _shade(labels, grid, hits, float(camera.pix_from_camera[0, 0]), near_m)
    image = Image.fromarray(rgb.reshape(height, width, 3))
    depth_m = hits.distance.reshape(height, width)

    # Lines keep their share of the picture at any size.
    line_pix = max(1, round(width / 500))
    pen = Pen(ImageDraw.Draw(image), depth_m, camera, tolerance_m=0.3 * grid.voxel_m)
    draw_floor(pen, grid, floor_m, line_pix)
    if frustum is not None:
        draw_frustum(pen, grid, frustum, frustum_share, line_pix + 1)
    draw_uav(pen, grid, floor_m, line_pix + 1)

    return np.asarray(image.reduce(SUPERSAMPLING))


def check_labels(labels: np.ndarray, grid: VoxelGrid) -> None:
    """Raise `UserError` unless the labels have the grid's shape."""
    if labels.shape != grid.shape:
        raise UserError(
            f"labels of shape {list(labels.shape)} do not fit grid.shape {list(grid.shape)}; "
            "draw them with the grid that they were made with"
        )


def cast_pixels(
    labels: UInt8[np.ndarray, "X Y Z"], grid: VoxelGrid, camera: Frustum, floor_m: float = -np.inf
) -> PixelHits:
    """Returns what the ray through each pixel's center meets first: a voxel, or the floor.

    The rays have unit z-depth: a hit's distance is its z-depth in metres.
    """
    pix = pixel_centers(*camera.size_pix).reshape(-1, 2)
    origin, rays = rays_in_grid(pix, camera.camera_from_occ, camera.pix_from_camera, grid)
    floor = (floor_m - grid.lower_m[2]) / grid.voxel_m
    return cast(labels < FREE, origin.numpy(), rays.contiguous().numpy(), SUN, floor)


def _shade(
    labels: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    hits: PixelHits,
    focal_pix: float,
    near_m: float,
) -> UInt8[np.ndarray, "n 3"]:
    """Color of every ray: class color x light x edge, fading with distance; white for a miss."""
    rgb = np.full((len(hits.kind), 3), 255.0, dtype=np.float32)
    floor, voxel = hits.kind == FLOOR, hits.kind == VOXEL
    rgb[floor] = FLOOR_COLOR * np.where(hits.sunlit[floor], 1.0, 0.90)[:, None]

    surface = PixelHits(*(field[voxel] for field in hits))
    brightness = _light(surface) * _edges(surface, focal_pix * grid.voxel_m / surface.distance)
    color = np.minimum(PALETTE[labels[tuple(surface.voxel.T)]] * brightness[:, None], 255)
    # Haze is thickest at the far end of the grid.
    haze = HAZE * np.clip((surface.distance - near_m) / (grid.upper_m[0] - grid.lower_m[0]), 0, 1)
    rgb[voxel] = color + (HAZE_COLOR - color) * haze[:, None]

    return rgb.round().astype(np.uint8)


def _light(surface: PixelHits) -> Float[np.ndarray, "n"]:
    """Sky and sun on faces: how open the corners are, the orientation, the shadows."""
    sky = SKY_LIGHT * (SHARE_IN_CORNERS + (1 - SHARE_IN_CORNERS) * surface.openness)
    sun = SUN / np.linalg.norm(SUN)
    return sky + SUN_LIGHT * np.clip(sun[surface.axis] * surface.side, 0, 1) * surface.sunlit


def _edges(surface: PixelHits, pix_per_voxel: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Darkening along the edges of faces, as thin as a pixel; none where voxels get tiny."""
    on_edge = surface.edge * pix_per_voxel < EDGE_PIX * SUPERSAMPLING
    strength = np.clip((pix_per_voxel / SUPERSAMPLING - 2) / 8, 0, 1)
    return 1 - EDGE_DARKENING * strength * on_edge
