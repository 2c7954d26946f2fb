"""The OpenGL matrices with which a renderer sees exactly what `geometry.project` says.

Nothing here knows pybullet: the matrices are plain lists in the order that it, and OpenGL, expect.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from torch import Tensor

NEAR_M: Final = 0.1
FAR_M: Final = 120.0
"""With these, TinyRenderer's float32 depth is good to 4 mm at 60 m."""

SAMPLE_OFFSET_PIX: Final = {"tiny": (-0.5, 0.5), "egl": (0.0, 0.0)}
"""What to add to the principal point ``(cx, cy)`` so that a renderer samples at pixel centres.

Bullet's TinyRenderer samples the image element at column i, row j at ``(u, v) = (i, j + 1)`` where
every other tool samples at ``(i + 0.5, j + 0.5)``.
"""

_EMPTY = 0.999
"""A depth beyond this share of the far plane is that of an empty pixel: TinyRenderer's background
reads one float32 step below 1, about a centimetre before the far plane."""


def view_matrix(camera_from_world: Float[Tensor, "4 4"]) -> list[float]:
    """OpenGL's view matrix, column-major: the same camera, looking along -z with y up."""
    return _column_major(camera_from_world * camera_from_world.new_tensor([1, -1, -1, 1])[:, None])


def projection_matrix(
    pix_from_camera: Float[Tensor, "3 3"],
    width: int,
    height: int,
    near_m: float,
    far_m: float,
    sample_offset_pix: tuple[float, float],
) -> list[float]:
    """OpenGL's projection matrix, column-major: the off-centre frustum of a pinhole camera.

    ``sample_offset_pix`` is the renderer's entry in `SAMPLE_OFFSET_PIX`. The third row of
    ``pix_from_camera`` is (0, 0, 1).
    """
    u, v, depth = pix_from_camera
    du, dv = sample_offset_pix
    clip_from_camera = pix_from_camera.new_zeros(4, 4)
    clip_from_camera[0, :3] = 2 * (u + du * depth) / width - depth
    clip_from_camera[1, :3] = depth - 2 * (v + dv * depth) / height
    clip_from_camera[2, 2] = (far_m + near_m) / (far_m - near_m)
    clip_from_camera[2, 3] = -2 * far_m * near_m / (far_m - near_m)
    clip_from_camera[3, :3] = depth
    camera_from_gl = clip_from_camera.new_tensor([1, -1, -1, 1])
    return _column_major(clip_from_camera * camera_from_gl)


def depth_from_buffer(
    buffer: Float[np.ndarray, "h w"], near_m: float, far_m: float
) -> Float[np.ndarray, "h w"]:
    """Z-depth in metres (float64) of an OpenGL depth buffer in [0, 1]; inf where nothing is hit."""
    depth_m = far_m * near_m / (far_m - (far_m - near_m) * buffer.astype(np.float64))
    return np.where(depth_m < _EMPTY * far_m, depth_m, np.inf)


def _column_major(matrix: Float[Tensor, "4 4"]) -> list[float]:
    return matrix.T.flatten().tolist()
