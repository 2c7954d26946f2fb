"""Rays through pixels, as they go through a voxel grid."""

import torch
from jaxtyping import Float
from torch import Tensor

from .geometry import VoxelGrid, inverse, unproject


def rays_in_grid(
    pix: Float[Tensor, "n 2"],
    camera_from_occ: Float[Tensor, "4 4"],
    pix_from_camera: Float[Tensor, "3 3"],
    grid: VoxelGrid,
) -> tuple[Float[Tensor, "3"], Float[Tensor, "n 3"]]:
    """Origin and directions (float64) of the rays through image locations, in voxels of a grid.

    A direction is a metre of z-depth long, so distances in its lengths are z-depths in metres.
    """
    occ_from_camera = inverse(camera_from_occ.double())
    one_metre = torch.ones(len(pix), dtype=torch.float64)
    rays_camera = unproject(pix.double(), one_metre, pix_from_camera.double())
    directions = rays_camera @ occ_from_camera[:3, :3].T / grid.voxel_m
    return (occ_from_camera[:3, 3] - torch.tensor(grid.lower_m)) / grid.voxel_m, directions
