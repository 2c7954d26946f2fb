"""Lines in a rendered picture that voxels in front of them hide: ground plane, UAV, frustum."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from PIL import ImageDraw

from ..geometry import VoxelGrid
from .view import Frustum

FLOOR_LINE_M = 10.0
FLOOR_LINE_COLOR, PLUMB_COLOR, FRUSTUM_COLOR = (214, 219, 226), (90, 96, 106), (235, 94, 20)
UAV_COLOR, ROTOR_COLOR = (24, 28, 36), (225, 230, 236)

# Span of the drawn UAV, as a share of the grid's length.
UAV_SHARE = 0.045

Point = Sequence[float]


@dataclass
class Pen:
    """Draws points of the occ frame (m) into a picture, behind what its depth buffer holds."""

    draw: ImageDraw.ImageDraw
    depth_m: Float[np.ndarray, "h w"]
    camera: Frustum
    tolerance_m: float

    def line(self, start: Point, end: Point, color: tuple, width_pix: int) -> None:
        """A straight line, cut up so that it can be half hidden."""
        # Pieces are short enough that a voxel's edge cuts a line cleanly.
        share = torch.linspace(0, 1, 161, dtype=torch.float64)[:, None]
        first, last = torch.tensor([[*start], [*end]], dtype=torch.float64)
        pix, depth_m = (
            each.numpy() for each in self.camera.project(first + share * (last - first))
        )

        # A point beside the picture is compared with the pixel at its border.
        border = np.subtract(self.depth_m.shape[::-1], 1)
        column, row = np.clip(np.floor(pix), 0, border).astype(int).T
        visible = (depth_m > 0) & (depth_m <= self.depth_m[row, column] + self.tolerance_m)

        points = [tuple(point) for point in pix.tolist()]
        for n in np.flatnonzero(visible[:-1] & visible[1:]):
            self.draw.line([points[n], points[n + 1]], fill=color, width=width_pix)

    def disc(self, middle: Point, radius_m: float, color: tuple) -> None:
        """A filled horizontal disc, drawn whole."""
        angle = torch.arange(24, dtype=torch.float64) * (2 * math.pi / 24)
        rim = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], dim=-1)
        middle = torch.tensor(middle, dtype=torch.float64)
        pix, depth_m = self.camera.project(middle + radius_m * rim)
        if (depth_m > 0).all():
            self.draw.polygon([tuple(point) for point in pix.tolist()], fill=color)


def draw_floor(pen: Pen, grid: VoxelGrid, floor_m: float, width_pix: int) -> None:
    """The footprint of the grid on the ground plane, with a line every 10 m."""
    (x0, y0, _), (x1, y1, _) = grid.lower_m, grid.upper_m
    for x in _ticks(x0, x1):
        pen.line((x, y0, floor_m), (x, y1, floor_m), FLOOR_LINE_COLOR, width_pix)
    for y in _ticks(y0, y1):
        pen.line((x0, y, floor_m), (x1, y, floor_m), FLOOR_LINE_COLOR, width_pix)


def _ticks(lower_m: float, upper_m: float) -> set[float]:
    """The two ends and the multiples of 10 m between them."""
    first, last = math.ceil(lower_m / FLOOR_LINE_M), math.floor(upper_m / FLOOR_LINE_M)
    return {lower_m, upper_m, *(n * FLOOR_LINE_M for n in range(first, last + 1))}


def draw_uav(pen: Pen, grid: VoxelGrid, floor_m: float, width_pix: int) -> None:
    """A quadrotor at the origin, and its plumb line down to the ground."""
    span_m = UAV_SHARE * (grid.upper_m[0] - grid.lower_m[0])
    origin, foot, arm_m = (0.0, 0.0, 0.0), (0.0, 0.0, floor_m), 0.36 * span_m
    pen.line(origin, foot, PLUMB_COLOR, width_pix)
    pen.disc(foot, 0.2 * span_m, PLUMB_COLOR)
    for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        rotor = (x * arm_m, y * arm_m, 0.0)
        pen.line(origin, rotor, UAV_COLOR, 2 * width_pix)
        pen.disc(rotor, 0.26 * span_m, UAV_COLOR)
        pen.disc(rotor, 0.17 * span_m, ROTOR_COLOR)
    pen.disc(origin, 0.2 * span_m, UAV_COLOR)
