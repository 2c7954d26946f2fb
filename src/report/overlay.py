"""Lines in a rendered picture that voxels in front of them hide: ground plane, UAV, frustum."""

import math

import numpy as np
import torch
from jaxtyping import Float
from PIL import ImageDraw
from torch import Tensor

from ..geometry import VoxelGrid
from .view import Frustum

FLOOR_LINE_M = 10.0
FLOOR_LINE_COLOR, PLUMB_COLOR, FRUSTUM_COLOR = (214, 219, 226), (90, 96, 106), (235, 94, 20)
UAV_COLOR, ROTOR_COLOR = (24, 28, 36), (225, 230, 236)

# Span of the drawn UAV and depth of the drawn frustum, as shares of the grid's length.
UAV_SHARE, FRUSTUM_SHARE = 0.045, 0.16


class Pen:
    """Draws polylines of the occ frame into a picture, behind what its depth buffer holds."""

    def __init__(
        self,
        draw: ImageDraw.ImageDraw,
        depth_m: Float[np.ndarray, "h w"],
        camera: Frustum,
        tolerance_m: float,
    ) -> None:
        self.draw, self.depth_m = draw, depth_m
        self.camera, self.tolerance_m = camera, tolerance_m

    def line(
        self, start: Float[Tensor, "3"], end: Float[Tensor, "3"], color: tuple, width_pix: int
    ) -> None:
        """A straight line between two points in metres, cut up so that it can be half hidden."""
        # Pieces are short enough that a voxel's edge cuts a line cleanly.
        share = torch.linspace(0, 1, 161, dtype=torch.float64)[:, None]
        pix, depth_m = self.camera.project(start + share * (end - start))
        visible = self._visible(pix.numpy(), depth_m.numpy())
        points = [tuple(point) for point in pix.tolist()]
        for n in np.flatnonzero(visible[:-1] & visible[1:]):
            self.draw.line([points[n], points[n + 1]], fill=color, width=width_pix)

    def disc(self, middle: Float[Tensor, "3"], radius_m: float, color: tuple) -> None:
        """A filled horizontal disc, drawn whole."""
        angle = torch.arange(24, dtype=torch.float64) * (2 * math.pi / 24)
        rim = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], dim=-1)
        pix, depth_m = self.camera.project(middle + radius_m * rim)
        if (depth_m > 0).all():
            self.draw.polygon([tuple(point) for point in pix.tolist()], fill=color)

    def _visible(self, pix: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
        height, width = self.depth_m.shape
        # A point beside the picture is compared with the pixel at its border.
        column = np.clip(np.floor(pix[:, 0]), 0, width - 1).astype(int)
        row = np.clip(np.floor(pix[:, 1]), 0, height - 1).astype(int)
        return (depth_m > 0) & (depth_m <= self.depth_m[row, column] + self.tolerance_m)


def draw_floor(pen: Pen, grid: VoxelGrid, floor_m: float, width_pix: int) -> None:
    """The footprint of the grid on the ground plane, with a line every 10 m."""
    (x0, y0, _), (x1, y1, _) = grid.lower_m, grid.upper_m
    for x in _ticks(x0, x1):
        pen.line(_point(x, y0, floor_m), _point(x, y1, floor_m), FLOOR_LINE_COLOR, width_pix)
    for y in _ticks(y0, y1):
        pen.line(_point(x0, y, floor_m), _point(x1, y, floor_m), FLOOR_LINE_COLOR, width_pix)


def _ticks(lower_m: float, upper_m: float) -> list[float]:
    """The two ends and the multiples of 10 m between them."""
    first, last = math.ceil(lower_m / FLOOR_LINE_M), math.floor(upper_m / FLOOR_LINE_M)
    between = {n * FLOOR_LINE_M for n in range(first, last + 1)}
    return sorted(between | {lower_m, upper_m})


def draw_uav(pen: Pen, grid: VoxelGrid, floor_m: float, width_pix: int) -> None:
    """A quadrotor at the origin, and its plumb line down to the ground."""
    span_m = UAV_SHARE * (grid.upper_m[0] - grid.lower_m[0])
    origin, foot = _point(0, 0, 0), _point(0, 0, floor_m)
    pen.line(origin, foot, PLUMB_COLOR, width_pix)
    pen.disc(foot, 0.2 * span_m, PLUMB_COLOR)
    for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        rotor = _point(x, y, 0) * 0.36 * span_m
        pen.line(origin, rotor, UAV_COLOR, 2 * width_pix)
        pen.disc(rotor, 0.26 * span_m, UAV_COLOR)
        pen.disc(rotor, 0.17 * span_m, ROTOR_COLOR)
    pen.disc(origin, 0.2 * span_m, UAV_COLOR)


def draw_frustum(pen: Pen, grid: VoxelGrid, frustum: Frustum, share: float, width_pix: int) -> None:
    """The pyramid between the camera and its image, as tilted as the UAV is, and as deep as a share
    of the grid's length."""
    corners = frustum.corners(share * (grid.upper_m[0] - grid.lower_m[0]))
    apex = frustum.corners(0.0)[0]
    for corner, following in zip(corners, corners.roll(-1, dims=0)):
        pen.line(apex, corner, FRUSTUM_COLOR, width_pix)
        pen.line(corner, following, FRUSTUM_COLOR, width_pix)


def _point(x_m: float, y_m: float, z_m: float) -> Float[Tensor, "3"]:
    return torch.tensor([x_m, y_m, z_m], dtype=torch.float64)
