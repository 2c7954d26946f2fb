"""The space that the UAV is about to sweep, and shapes grown by a voxel."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ...geometry import VoxelGrid

Box = tuple[slice, slice, slice]


def swept_tube(
    grid: VoxelGrid, velocity_mps: Float[Tensor, "3"], seconds: float, radius_m: float
) -> tuple[Box, Bool[Tensor, "x y z"]]:
    """The voxels whose centre is within a radius of the path of the next seconds.

    The path is the straight line from the origin of the occ frame at the current velocity. Returns
    the box of indices around the tube, and which of its voxels belong to it. On the CPU.
    """
    end_m = velocity_mps.detach().double().cpu() * seconds
    lower_m = torch.tensor(grid.lower_m, dtype=torch.float64)
    first = (end_m.clamp(max=0) - radius_m - lower_m) / grid.voxel_m
    last = (end_m.clamp(min=0) + radius_m - lower_m) / grid.voxel_m
    box = tuple(
        slice(max(0, int(a)), max(0, min(int(b) + 1, size)))
        for a, b, size in zip(first.floor().tolist(), last.floor().tolist(), grid.shape)
    )
    axes = [
        low + grid.voxel_m * (torch.arange(size, dtype=torch.float64)[side] + 0.5)
        for low, size, side in zip(lower_m, grid.shape, box)
    ]
    centers_m = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)
    length2 = end_m.square().sum()
    along = (centers_m @ end_m / length2).clamp(0, 1) if length2 > 0 else centers_m[..., 0] * 0
    distance2 = (centers_m - along[..., None] * end_m).square().sum(-1)
    return box, distance2 <= radius_m**2


def grown(shape: Bool[Tensor, "X Y Z"], voxels: int) -> Bool[Tensor, "X Y Z"]:
    """What is within some voxels of a shape, diagonals included."""
    for _ in range(voxels):
        for axis in range(3):
            wider = shape.clone()
            size = shape.shape[axis]
            wider.narrow(axis, 1, size - 1).logical_or_(shape.narrow(axis, 0, size - 1))
            wider.narrow(axis, 0, size - 1).logical_or_(shape.narrow(axis, 1, size - 1))
            shape = wider
    return shape
