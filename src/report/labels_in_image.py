"""Labels laid over the image that they belong to, through a camera."""

import numpy as np
from jaxtyping import UInt8

from ..geometry import VoxelGrid
from .raycast import VOXEL
from .view import Frustum
from .voxels import PALETTE, cast_pixels

# How much of a pixel is its voxel's color, and how much darker the voxel's edges are.
COLOR_SHARE, EDGE_SHARE = 0.6, 0.35


def labels_in_image(
    image: UInt8[np.ndarray, "h w 3"],
    labels: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    camera: Frustum,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image, every pixel tinted by the first occupied voxel on its ray, edges darker.

    The ray is the one through the pixel's center. With another ``camera`` than the one that took
    the image, colors stand beside their objects.
    """
    hits = cast_pixels(labels, grid, camera)
    met = hits.kind == VOXEL

    color = PALETTE[labels[tuple(hits.voxel[met].T)]]
    # An edge is a pixel wide, however far away it is.
    pixel = hits.distance[met] / float(camera.pix_from_camera[0, 0]) / grid.voxel_m
    color = color * (1 - EDGE_SHARE * (hits.edge[met] < pixel))[:, None]

    tinted = image.reshape(-1, 3).astype(np.float32)
    tinted[met] += COLOR_SHARE * (color - tinted[met])

    return np.rint(tinted).astype(np.uint8).reshape(image.shape)
