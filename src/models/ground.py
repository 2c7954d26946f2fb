"""A volume that stands on the world's ground plane, and what of it the occ frame's grid sees."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid, rigid

# A barometer that was set to zero at take-off drifts.
LOWEST_M = -1.0


def above_ground(grid: VoxelGrid, lower_m: float, upper_m: float) -> VoxelGrid:
    """Returns the pillars of a grid from ``lower_m`` to ``upper_m`` above the ground.

    Voxels are as large as those of ``grid``. Raises `UserError` where the heights are no whole
    number of them apart.
    """
    bins = round((upper_m - lower_m) / grid.voxel_m)
    return VoxelGrid(
        (*grid.lower_m[:2], lower_m), (*grid.upper_m[:2], upper_m), (*grid.shape[:2], bins)
    )


def occ_from_ground(height_m: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 4 4"]:
    """Returns the transform for a UAV at that height.

    The ground frame is the occ frame, lowered onto the ground plane.
    """
    zero = torch.zeros_like(height_m)
    below_m = torch.stack([zero, zero, -height_m], dim=-1)
    return rigid(torch.eye(3).to(height_m).expand(*height_m.shape, 3, 3), below_m)


def require_height(
    name: str, height_m: Float[Tensor, "*n"], heights_m: Sequence[float] | None
) -> None:
    """Raises `UserError` for heights beyond those that a network knows; ``None``: it knows all."""
    lowest_m, highest_m = heights_m or (-math.inf, math.inf)
    outside = height_m[(height_m < lowest_m) | (height_m > highest_m)]
    if outside.numel():
        raise UserError(
            f"{name}: z is {float(outside.flatten()[0]):g} m, and this network flies {lowest_m:g} "
            f"to {highest_m:g} m above the ground; z counts upwards from the ground plane below, "
            "not from sea level"
        )


class GroundVolume(nn.Module):
    """Brings logits of a volume above the ground to the voxels of the UAV's own grid.

    The occ frame moves up and down with the UAV, and with it the place of the ground in a pillar.
    ``volume`` has the same pillars, and counts z from the ground plane below the UAV (the ground
    frame): there the ground, a kerb and a car always lie at the same height. The UAV's measured
    height, as of a barometer that was set to zero at take-off, says how far it lies below the occ
    frame of ``grid``. In between two centers logits are interpolated; beyond the first and the last
    one they stay what they are there.

    Raises `UserError` where the pillars of the two differ.
    """

    def __init__(self, volume: VoxelGrid, grid: VoxelGrid) -> None:
        super().__init__()
        for name in ("lower_m", "upper_m", "shape"):
            in_volume, in_grid = list(getattr(volume, name)[:2]), list(getattr(grid, name)[:2])
            if in_volume != in_grid:
                raise UserError(
                    f"model.decoder.grid.{name}: {in_volume} in x and y, and grid.{name} has "
                    f"{in_grid}; a volume on the ground changes z alone"
                )

        self.bins = volume.shape[2]
        self.voxel_m = grid.voxel_m
        z_m = grid.centers()[0, 0, :, 2] - volume.centers()[0, 0, 0, 2]
        self.register_buffer("z_m", z_m, persistent=False)

    @property
    def heights_m(self) -> tuple[float, float]:
        """The lowest and the highest flight above the ground: higher up, the volume and the grid of
        the UAV would share no voxel."""
        return LOWEST_M, (self.bins - 0.5) * self.voxel_m - float(self.z_m[0])

    def forward(
        self, logits: Float[Tensor, "b c x y k"], height_m: Float[Tensor, "b"]
    ) -> Float[Tensor, "b c x y z"]:
        """Returns logits of the occ frame's voxels, for a UAV ``height_m`` above the ground."""
        # Autocast would round them to 8 bits.
        with torch.autocast(logits.device.type, enabled=False):
            place = (self.z_m + height_m.float()[:, None]) / self.voxel_m
            place = place.clamp(0, self.bins - 1)[:, None]
            bins = torch.arange(self.bins, device=place.device)[:, None]
            # Linear interpolation as one matrix: at most two bins share a voxel.
            share = (1 - (place - bins).abs()).clamp(min=0)
            return (logits.flatten(1, 3) @ share).unflatten(1, logits.shape[1:4])
