"""Which voxels a camera sees, which ones something hides, and at which it never looked."""

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from .geometry import Array, VoxelGrid, tensor_of
from .jit import njit
from .voxels import advance, enter, is_inside, rays_in_grid

Voxels = Bool[np.ndarray, "X Y Z"]

NEVER_LOOKED, HIDDEN, SEEN = range(3)


def seen(
    occupied: Voxels,
    camera_from_occ: Float[Array, "4 4"],
    pix_from_camera: Float[Array, "3 3"],
    size_pix: tuple[int, int],
    grid: VoxelGrid,
) -> Voxels:
    """Returns the voxels in front of the camera that no occupied one hides: those that a ray
    passes. Rays are two pixels apart, or as close as voxels at the grid's far end want it.
    ``size_pix`` is width and height."""
    focal_pix = float(pix_from_camera[0][0])
    step_pix = min(2.0, grid.voxel_m * focal_pix / max(grid.upper_m[0], grid.voxel_m))

    axes = (torch.arange(0.5, size, step_pix, dtype=torch.float64) for size in size_pix)
    pix = torch.cartesian_prod(*axes)

    camera = tensor_of(camera_from_occ), tensor_of(pix_from_camera)
    origin, directions = rays_in_grid(pix, *camera, grid)
    return in_sight(occupied, origin.numpy(), np.ascontiguousarray(directions.numpy()))


def knowledge(occupied: Voxels, *camera: object) -> UInt8[np.ndarray, "X Y Z"]:
    """Returns `SEEN`, `HIDDEN` or `NEVER_LOOKED` for every voxel; the arguments are those of
    `seen`.

    With predicted labels that is what a UAV can tell by itself, without the truth: where it has not
    looked, its prediction is a guess.
    """
    in_view = seen(np.zeros_like(occupied), *camera)
    told = np.where(in_view, HIDDEN, NEVER_LOOKED).astype(np.uint8)
    told[seen(occupied, *camera)] = SEEN
    return told


@njit(error_model="numpy")
def in_sight(
    occupied: Voxels, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
) -> Voxels:
    """Returns the voxels that rays pass, up to and with the first occupied one; all in grid
    coordinates. The voxel that a ray begins in hides nothing."""
    seen = np.zeros(occupied.shape, dtype=np.bool_)
    for n in range(len(directions)):
        ray = enter(occupied.shape, origin, directions[n])
        while is_inside(occupied.shape, ray):
            seen[ray.cell] = True
            if occupied[ray.cell] and ray.axis >= 0:
                break
            ray = advance(ray)
    return seen
