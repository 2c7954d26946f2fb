"""Semantic voxels from above: a map with the UAV's heading up and its left on the left."""

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from ..geometry import VoxelGrid
from ..ontology import COLORS, FREE
from .canvas import Pixels
from .view import Labels, SizePix
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


def render_top(labels: Labels, grid: VoxelGrid, size_pix: SizePix) -> Pixels:
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
    map_width, map_height = round(breadth_m * pix_per_m), round(length_m * pix_per_m)
    left = (width - map_width) // 2
    bottom = margin + map_height

    image = Image.new("RGB", (width, height), (255, 255, 255))
    upright = Image.fromarray(_column_colors(labels, grid)[::-1, ::-1].round().astype(np.uint8))
    image.paste(upright.resize((map_width, map_height), Image.Resampling.NEAREST), (left, margin))
    draw = ImageDraw.Draw(image)
    draw.rectangle((left, margin, left + map_width, bottom), outline=FRAME, width=SUPERSAMPLING)

    # The UAV is an arrow head at the origin, pointing up the map.
    u, v = left + grid.upper_m[1] * pix_per_m, margin + grid.upper_m[0] * pix_per_m
    size = 0.035 * map_height
    arrow = ((0, -1), (0.75, 1), (0, 0.5), (-0.75, 1))
    points = [(u + x * size, v + y * size) for x, y in arrow]
    draw.polygon(points, fill=INK, outline=(255, 255, 255), width=SUPERSAMPLING)
    _draw_scale(draw, left, bottom, SCALE_BAR_M * pix_per_m, strip)
    return np.asarray(image.reduce(SUPERSAMPLING))


def _column_colors(labels: Labels, grid: VoxelGrid) -> Float[np.ndarray, "X Y 3"]:
    """Returns the color of every column of voxels, 0 to 255."""
    occupied = labels < FREE
    anything = occupied.any(axis=2)
    top = np.where(anything, grid.shape[2] - 1 - np.argmax(occupied[:, :, ::-1], axis=2), 0)
    color = np.full((*grid.shape[:2], 3), COLORS["unknown"], dtype=np.float32)
    color[(labels == FREE).any(axis=2)] = COLORS["free"]

    # A step up of the neighbor towards the sun, ahead or left, darkens what is behind it.
    padded = np.pad(top, ((0, 1), (0, 1)), mode="edge")
    highest = np.max([padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]], axis=0)
    shade = 1 - STEP_SHADE * np.clip((highest - top) * grid.voxel_m / STEP_M, 0, 1)
    brightness = (DARKEST + (BRIGHTEST - DARKEST) * top / max(grid.shape[2] - 1, 1)) * shade

    class_ids = np.take_along_axis(labels, top[:, :, None], axis=2)[:, :, 0]
    color[anything] = np.minimum(PALETTE[class_ids[anything]] * brightness[anything][:, None], 255)
    return color


def _draw_scale(
    draw: ImageDraw.ImageDraw, left: int, top: int, length_pix: float, strip: int
) -> None:
    """Draws a bar of 10 m below the map's lower left corner."""
    right, v = left + length_pix, top + 0.42 * strip
    draw.line([(left, v), (right, v)], fill=INK, width=round(0.1 * strip))
    font = ImageFont.load_default(size=0.55 * strip)
    draw.text((right + 0.2 * strip, v), f"{SCALE_BAR_M} m", fill=INK, font=font, anchor="lm")
