"""The OpenGL matrices with which a renderer sees a point exactly where `geometry.project` puts it.

Nothing here knows pybullet: the matrices are plain lists in the order that it, and OpenGL, expect.
"""

from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..geometry import transform, unproject

# With these planes, TinyRenderer's float32 depth is good to 4 mm at 60 m.
NEAR_M: Final = 0.1
FAR_M: Final = 120.0

# A renderer samples at pixel centers once this is added to the principal point ``(cx, cy)``.
# Bullet's TinyRenderer samples the image element at column i, row j at ``(u, v) = (i, j + 1)``
# where every other tool samples at ``(i + 0.5, j + 0.5)``.
SAMPLE_OFFSET_PIX: Final = {"tiny": (-0.5, 0.5), "egl": (0.0, 0.0)}

# A depth beyond this share of the far plane is that of an empty pixel: TinyRenderer's background
# reads one float32 step below 1, about a centimeter before the far plane.
_EMPTY = 0.999

# Renderers compute in float32: what they draw may lie this far from where it is.
_SLACK_M = 0.05


def view_matrix(camera_from_world: Float[Tensor, "4 4"]) -> list[float]:
    """Returns OpenGL's view matrix, column-major, whose camera looks along -z with y up."""
    return _column_major(camera_from_world * camera_from_world.new_tensor([1, -1, -1, 1])[:, None])


def projection_matrix(
    pix_from_camera: Float[Tensor, "3 3"],
    width: int,
    height: int,
    near_m: float,
    far_m: float,
    sample_offset_pix: tuple[float, float],
) -> list[float]:
    """Returns OpenGL's projection matrix, column-major: the off-center frustum of a pinhole camera.

    ``sample_offset_pix`` is the renderer's entry in `SAMPLE_OFFSET_PIX`.
    """
    # The third row of pix_from_camera is (0, 0, 1): it gives the depth.
    u, v, depth = pix_from_camera
    du, dv = sample_offset_pix

    # OpenGL's clip space spans -1 to 1 over the image, with y up, and over the depth range.
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
    """Returns the z-depth in metres (float64) of an OpenGL depth buffer in [0, 1].

    It is inf where nothing is hit.
    """
    depth_m = far_m * near_m / (far_m - (far_m - near_m) * buffer.astype(np.float64))
    return np.where(depth_m < _EMPTY * far_m, depth_m, np.inf)


def frustum_planes(
    pix_from_camera: Float[Tensor, "3 3"], width: int, height: int
) -> Float[np.ndarray, "4 3"]:
    """Returns the unit normals of the planes through the image's sides.

    They point inwards and are given in the camera's frame.
    """
    corners_pix = torch.tensor([[0, 0], [width, 0], [width, height], [0, height]])
    one_m = torch.ones(4, dtype=pix_from_camera.dtype)
    corners = unproject(corners_pix.to(pix_from_camera), one_m, pix_from_camera).numpy()
    normals = np.cross(corners, np.roll(corners, -1, axis=0))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def in_view(
    planes: Float[np.ndarray, "4 3"],
    camera_from_world: Float[np.ndarray, "4 4"],
    middle_m: Float[np.ndarray, "n 3"],
    reach_m: Float[np.ndarray, "n"],
    far_m: float = FAR_M,
) -> Bool[np.ndarray, "n"]:
    """Returns which spheres may be seen: false only for those of which no point can.

    ``planes`` are those of `frustum_planes`; the middles ``middle_m`` are places in the world.
    """
    middle_camera = transform(camera_from_world, middle_m)
    depth_m, reach_m = middle_camera[:, 2], reach_m + _SLACK_M

    # All planes pass through the camera, so a middle's product with a normal is its distance.
    inside = (middle_camera @ planes.T > -reach_m[:, None]).all(axis=1)
    return inside & (depth_m > -reach_m) & (depth_m < far_m + reach_m)


def _column_major(matrix: Float[Tensor, "4 4"]) -> list[float]:
    return matrix.T.flatten().tolist()
