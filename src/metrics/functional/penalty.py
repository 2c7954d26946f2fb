"""The penalty of an error by its worst-case time to collision, as a table by distance.

`kar_mean_iou` has the formula with the paper's equations. In sums an excess penalty ``p - 1`` is a
multiple of ``1 / FIXED_POINT``, held as int64, so sums over batches, ranks and devices agree to the
last bit in any order. Rounding moves a voxel's weight, which is at least 1, by at most 3e-8. A sum
overflows after ``2**63 / (FIXED_POINT * penalty_scale)`` errors at zero distance, 2.7e11 with the
paper's parameters: 100 times the paper's test set, all of it wrong.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int, Int64
from torch import Tensor

from ...errors import UserError
from ...geometry import VoxelGrid
from ...limits import require_finite
from .codes import Velocity

FIXED_POINT = 2**24


@dataclass(frozen=True)
class Penalty:
    """Parameters of the penalty; the defaults are the paper's (Table 5).

    With x a voxel's center in the occ frame and v the UAV's velocity::

        ttc = |x| / max(|v|, min_speed_mps)
        p   = 1 + [ttc <= horizon_s] * penalty_scale * exp(-decay_per_s * ttc)

    Raises `UserError` for a value with which it would not be a penalty.

    >>> [round(1 + float(Penalty().excess(torch.tensor(m), 2.0)), 3) for m in (1.0, 3.0, 5.0)]
    [2.81, 2.482, 2.213]
    """

    horizon_s: float = 5.0
    decay_per_s: float = 0.5
    penalty_scale: float = 2.0
    min_speed_mps: float = 5.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require_finite(name, value, zero=name != "min_speed_mps")

    def ttc_s(self, distance_m: Float[Tensor, "*v"], speed_mps: float) -> Float[Tensor, "*v"]:
        """Returns the worst-case time to collision, as if the UAV flew towards every voxel."""
        return distance_m / max(speed_mps, self.min_speed_mps)

    def excess(self, distance_m: Float[Tensor, "*v"], speed_mps: float) -> Float[Tensor, "*v"]:
        """Returns the weight of an error at a distance, less 1."""
        ttc_s = self.ttc_s(distance_m, speed_mps)
        near = ttc_s <= self.horizon_s
        return near * self.penalty_scale * torch.exp(-self.decay_per_s * ttc_s)

    def excess_table(self, shell_m: Float[Tensor, "s"], speed_mps: float) -> Int64[Tensor, "s"]:
        """Returns `excess` at every distance, in units of 1 / FIXED_POINT."""
        return torch.round(self.excess(shell_m, speed_mps) * FIXED_POINT).long()


def speeds(velocity: Velocity, batch: int, directed: str = "") -> list[float]:
    """Returns the speed in m/s of every frame of a batch, from its velocities or speeds.

    Raises `UserError` for another shape and for a number that is not finite; for speeds too where
    something is named that is ``directed``, and so needs velocities.
    """
    if directed and velocity.shape != (batch, 3):
        raise UserError(
            f"velocity: shape {list(velocity.shape)} is not [{batch}, 3]; {directed} needs "
            "velocities in the occ frame, not speeds"
        )
    if velocity.shape not in ((batch,), (batch, 3)):
        raise UserError(
            f"velocity: shape {list(velocity.shape)} does not fit a batch of {batch}; "
            f"give [{batch}, 3] velocities or [{batch}] speeds in m/s"
        )

    components = velocity.detach().double()
    rows = (components if velocity.ndim == 2 else components[:, None]).tolist()
    speeds_mps = [math.hypot(*row) for row in rows]
    if not all(map(math.isfinite, speeds_mps)):
        raise UserError("velocity: holds NaN or infinity; give finite velocities in m/s")
    return speeds_mps


def distance_shells(grid: VoxelGrid) -> tuple[Float[Tensor, "s"], Int[Tensor, "v"]]:
    """Returns the distinct distances of voxel centers from the UAV in metres, ascending, and which
    of them each voxel has.

    The paper's 600,000 voxels have but 6,559 distances, so a frame's penalties are a small table.
    It is computed on the CPU and at one place in memory order whatever the batch: an exponential
    may differ in its last bit between devices, and between the middle and the end of a vectorised
    loop.
    """
    distance_m = grid.centers(torch.float64).square().sum(-1).sqrt()
    rounded_m = distance_m.flatten().round(decimals=9)
    shell_m, shell = torch.unique(rounded_m, return_inverse=True)
    return shell_m, shell.to(torch.int32)
