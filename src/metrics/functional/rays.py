"""Rays of a camera, and what they meet in predicted and true labels."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ...geometry import VoxelGrid, inverse, pixel_centers, rotate, unproject
from .codes import NOTHING, Codes, Rays, Vector


def camera_rays(
    camera_from_occ: Float[Tensor, "b 4 4"],
    pix_from_camera: Float[Tensor, "b 3 3"],
    size_pix: tuple[int, int],
    rays: tuple[int, int] = (100, 56),
) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b n 3"]]:
    """Returns origins and unit directions, in the occ frame, of evenly spaced rays of an image.

    ``size_pix`` is the image's width and height, ``rays`` their number across and down: each goes
    through the center of its part of the image. float64, row by row.
    """
    # The centers of the pixels of an image with a pixel for each ray, on the image's own scale.
    pix = pixel_centers(*rays).flatten(0, 1) * torch.tensor(size_pix) / torch.tensor(rays)
    pix = pix.to(camera_from_occ.device).expand(len(camera_from_occ), -1, 2)

    points = unproject(pix, torch.ones_like(pix[..., 0]), pix_from_camera.double())
    occ_from_camera = inverse(camera_from_occ.double())
    directions = rotate(occ_from_camera, points)
    return occ_from_camera[:, :3, 3], torch.nn.functional.normalize(directions, dim=-1)


def first_met(
    codes: Codes, origin_m: Vector, directions: Rays, grid: VoxelGrid, free_index: int
) -> tuple[UInt8[np.ndarray, "2 n"], Float[np.ndarray, "2 n"]]:
    """Returns class and distance in metres of the first occupied voxel on every ray: predicted,
    then true.

    ``codes`` are those of `encode`; voxels that it does not count are passed through in both. The
    distance is to where the ray enters the voxel; 0 where it starts in it. On the CPU.
    """
    # Only here: importing the compiler takes a second.
    from .kernels import march

    # In voxels, as the march wants them. Directions keep their length in metres, so that what it
    # returns are metres.
    origin = (origin_m.double().cpu().numpy() - np.array(grid.lower_m)) / grid.voxel_m
    rays = np.ascontiguousarray(directions.double().cpu().numpy()) / grid.voxel_m

    classes = np.full((2, len(rays)), NOTHING, dtype=np.uint8)
    distances_m = np.full((2, len(rays)), np.inf)
    march(codes.cpu().contiguous().numpy(), origin, rays, free_index, classes, distances_m)
    return classes, distances_m
