"""What metrics share that look at the paths which the UAV could fly next."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_finite
from . import functional as F
from .count_metric import VoxelMetric


class PrimitiveMetric(VoxelMetric):
    """A `VoxelMetric` over motion primitives.

    A primitive is a path of the next ``seconds`` at the speed flown, ``min_speed_mps`` or more,
    with a steady climb angle and turn rate: all combinations of ``climbs_deg`` and
    ``turns_deg_per_s``. It sweeps all voxels within ``radius_m``. It is truly blocked if one of
    them is truly occupied, and clear if it has a label and none is. Unknown voxels never count.

    It takes the arguments of `VoxelMetric`. Raises `UserError` for paths that lead nowhere.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        turns_deg_per_s: Sequence[float] = (-45, -30, -15, 0, 15, 30, 45),
        climbs_deg: Sequence[float] = (-20, -10, 0, 10, 20),
        seconds: float = 2.0,
        radius_m: float = 1.0,
        min_speed_mps: float = 5.0,
        **kwargs: Any,
    ) -> None:
        require_finite("seconds", seconds)
        require_finite("radius_m", radius_m)
        require_finite("min_speed_mps", min_speed_mps, zero=True)
        for name, angles in (("turns_deg_per_s", turns_deg_per_s), ("climbs_deg", climbs_deg)):
            if not angles or not all(math.isfinite(angle) for angle in angles):
                raise UserError(f"{name}: {list(angles)} must be one finite number or more")

        super().__init__(grid, *arguments, **kwargs)
        self.turns_deg_per_s, self.climbs_deg = tuple(turns_deg_per_s), tuple(climbs_deg)
        self.seconds, self.radius_m, self.min_speed_mps = seconds, radius_m, min_speed_mps

    def swept(
        self,
        preds: F.Preds,
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None,
        logits: F.Logits | None = None,
    ) -> list[F.Swept]:
        """Returns the voxels that each frame's primitives sweep, climb by climb with all turns.

        Raises `UserError` for a bad batch, and for speeds: a primitive needs the direction.
        """
        codes = self.codes(preds, target, mask)
        speeds_mps = F.speeds(velocity, len(target), directed="a primitive")

        swept = []
        for n, frame in enumerate(codes):
            speed_mps = max(speeds_mps[n], self.min_speed_mps)
            paths_m = self.paths(velocity[n], speed_mps, self.grid.voxel_m / 2)
            scores = None if logits is None else logits[n]
            swept.append(F.swept(frame, scores, paths_m, self.radius_m, self.grid, self.free_index))
        return swept

    def paths(
        self, velocity_mps: Float[Tensor, "3"], speed_mps: float, step_m: float
    ) -> Float64[np.ndarray, "k n 3"]:
        """Returns points on every primitive, as `functional.primitive_paths` does."""
        angles = self.turns_deg_per_s, self.climbs_deg
        return F.primitive_paths(velocity_mps, speed_mps, *angles, self.seconds, step_m)
