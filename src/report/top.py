"""Semantic voxels from above: a map with the UAV's heading up and its left on the left."""

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from ..geometry import VoxelGrid
from ..ontology import COLORS, FREE
from .voxels import PALETTE, check_labels

SUPERSAMPLING = 2
SCALE_BAR_M = 10
# Room around the map, and below it for the UAV and the scale bar, as shares of the picture.
MARGIN, STRIP = 0.02, 0.09
# Brightness of the lowest and the highest voxel of the grid.
DARKEST, BRIGHTEST = 0.84, 1.16
# The ground behind a step this high, away from the sun at the top left, is darkened this much.
STEP_SHADE, STEP_M = 0.3, 5.0
INK, FRAME = (24, 28, 36), (150, 158, 168)


def render_top(
    labels: UInt8[np.ndarray, "X Y Z"], grid: VoxelGrid, size_pix: tuple[int, int] = (480, 480)
) -> UInt8[np.ndarray, "h w 3"]:
    """Draws a map of ``size_pix``: the class of the highest occupied voxel, brighter if higher.

    Columns with free space and nothing else are light, unknown ones white. Up is forward (+x), left
    is the UAV's left (+y); an arrow marks the UAV and its heading, a bar the scale. Raises
    `UserError` where the labels do not have the grid's shape.
    """
    check_labels(labels, grid)
    width, height = size_pix[0] * SUPERSAMPLING, size_pix[1] * SUPERSAMPLING
    margin, strip = round(MARGIN * height), round(STRIP * height)

    length_m, breadth_m = (grid.upper_m[a] - grid.lower_m[a] for a in (0, 1))
    pix_per_m = min((width - 2 * margin) / breadth_m, (height - 2 * margin - strip) / length_m)
    columns = _column_colors(labels, grid)
    upright = Image.fromarray(columns[::-1, ::-1].round().astype(np.uint8))
    size = (round(breadth_m * pix_per_m), round(length_m * pix_per_m))

    image = Image.new("RGB", (width, height), (255, 255, 255))
    corner = ((width - size[0]) // 2, margin)
    image.paste(upright.resize(size, Image.Resampling.NEAREST), corner)
    draw = ImageDraw.Draw(image)
    box = (*corner, corner[0] + size[0], corner[1] + size[1])
    draw.rectangle(box, outline=FRAME, width=SUPERSAMPLING)
    _draw_uav(draw, grid, box, pix_per_m)
    _draw_scale(draw, (box[0], box[3]), pix_per_m, strip)
    return np.asarray(image.reduce(SUPERSAMPLING))


def _column_colors(
    labels: UInt8[np.ndarray, "X Y Z"], grid: VoxelGrid
) -> Float[np.ndarray, "X Y 3"]:
    """Returns the color of every column of voxels, 0 to 255."""
    occupied = labels < FREE
    top = grid.shape[2] - 1 - np.argmax(occupied[:, :, ::-1], axis=2)
    anything = occupied.any(axis=2)

    color = np.full((*grid.shape[:2], 3), COLORS["unknown"], dtype=np.float32)
    color[(labels == FREE).any(axis=2)] = COLORS["free"]

    class_ids = np.take_along_axis(labels, top[:, :, None], axis=2)[:, :, 0][anything]
    share = top[anything] / max(grid.shape[2] - 1, 1)
    brightness = (DARKEST + (BRIGHTEST - DARKEST) * share) * _step_shade(
        np.where(anything, top, 0), grid
    )[anything]
    color[anything] = np.minimum(PALETTE[class_ids] * brightness[:, None], 255)
    return color


def _step_shade(top: np.ndarray, grid: VoxelGrid) -> Float[np.ndarray, "X Y"]:
    """Returns how much to darken: where the neighbor towards the sun, ahead or left, is higher."""
    padded = np.pad(top, ((0, 1), (0, 1)), mode="edge")
    ahead, left, both = padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]
    highest = np.maximum(np.maximum(ahead, left), both)
    return 1 - STEP_SHADE * np.clip((highest - top) * grid.voxel_m / STEP_M, 0, 1)


def _draw_uav(draw: ImageDraw.ImageDraw, grid: VoxelGrid, box: tuple, pix_per_m: float) -> None:
    """Draws an arrow head at the origin, pointing up the map."""
    u = box[0] + grid.upper_m[1] * pix_per_m
    v = box[1] + grid.upper_m[0] * pix_per_m
    size = 0.035 * (box[3] - box[1])
    arrow = [(u, v - size), (u + 0.75 * size, v + size), (u, v + 0.5 * size)]
    arrow.append((u - 0.75 * size, v + size))
    draw.polygon(arrow, fill=INK, outline=(255, 255, 255), width=SUPERSAMPLING)


def _draw_scale(
    draw: ImageDraw.ImageDraw, corner: tuple[int, int], pix_per_m: float, strip: int
) -> None:
    """Draws a bar of 10 m below the map's lower left corner."""
    u0, u1 = corner[0], corner[0] + SCALE_BAR_M * pix_per_m
    v, tick = corner[1] + 0.42 * strip, 0.12 * strip
    line = max(SUPERSAMPLING, round(0.05 * strip))
    draw.line([(u0, v), (u1, v)], fill=INK, width=line)
    for u in (u0 + line / 2, u1):
        draw.line([(u, v - tick), (u, v + tick)], fill=INK, width=line)

    font = ImageFont.load_default(size=0.55 * strip)
    draw.text((u1 + 0.2 * strip, v), f"{SCALE_BAR_M} m", fill=INK, font=font, anchor="lm")
