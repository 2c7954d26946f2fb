"""What metrics share that look at the paths which the UAV could fly next."""

import math
from collections.abc import Sequence
from typing import Any

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_positive
from . import functional as F
from .tables import VoxelMetric


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
        require_positive({"seconds": seconds, "radius_m": radius_m})
        if not (math.isfinite(min_speed_mps) and min_speed_mps >= 0):
            raise UserError(f"min_speed_mps: {min_speed_mps} must be a finite number, 0 or more")
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
        """Returns what the primitives of each frame sweep, climb by climb with all its turns.

        Raises `UserError` for a bad batch, and for speeds: a primitive needs the direction.
        """
        codes = self.codes(preds, target, mask)
        F.require_directions(velocity, len(target), "a primitive")
        speeds_mps = F.speeds(velocity, batch=len(target))

        swept = []
        for n, frame in enumerate(codes):
            paths_m = F.primitive_paths(
                velocity[n],
                max(speeds_mps[n], self.min_speed_mps),
                self.turns_deg_per_s,
                self.climbs_deg,
                self.seconds,
                self.grid.voxel_m / 2,
            )
            scores = None if logits is None else logits[n]
            swept.append(F.swept(frame, scores, paths_m, self.radius_m, self.grid, self.free_index))
        return swept
