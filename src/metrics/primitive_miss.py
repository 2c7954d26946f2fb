"""Whether the paths that the UAV could fly next are blocked, and whether the prediction says so."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .functional.primitives import CLEAR
from .tables import Scores, Tables, VoxelMetric

# The log-odds that a path is blocked are sorted into bins of an eighth, from -16 to 16.
BINS, BINS_A_UNIT = 256, 8


class PrimitiveMiss(VoxelMetric):
    """Blocked motion primitives that the prediction calls free.

    A primitive is a path of the next ``seconds`` at the speed flown, ``min_speed_mps`` or more,
    with a steady climb angle and turn rate: all combinations of ``climbs_deg`` and
    ``turns_deg_per_s``. It sweeps all voxels within ``radius_m``. It is truly blocked if one of
    them is truly occupied, and clear if it has a label and none is. Unknown voxels never count.

    The prediction says how likely a primitive is blocked by the highest odds of occupied in it. A
    *phantom block* is a clear primitive that is called blocked. `compute` gives

    - ``primitive_miss``: the share of the blocked primitives that are called clear, at the
      threshold at which ``phantoms`` (1 %) of the clear ones are called blocked; between two
      thresholds the share is interpolated,
    - ``primitive_miss/<class>``: the same of those in which this class is met first,
    - ``primitive_auc``: the area under the curve of called blocked, of the blocked, by called
      blocked, of the clear: 0.5 is chance,
    - ``primitive_miss_argmax`` and ``primitive_phantoms_argmax``: both shares, where a primitive is
      called blocked if a voxel in it is predicted occupied.

    The first three take logits, and are NaN for labels. It takes the arguments of `VoxelMetric`.
    Raises `UserError` for paths that lead nowhere, and for shares outside 0 to 1.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 3, 8]).view(1, 4, 1, 1)
    >>> ahead = PrimitiveMiss(grid, turns_deg_per_s=[0.0], climbs_deg=[0.0])
    >>> ahead.update(torch.full_like(target, 8), target, velocity=torch.tensor([[5.0, 0.0, 0.0]]))
    >>> float(ahead.compute()["primitive_miss_argmax"])
    1.0
    """

    higher_is_better = None
    blocked: Tensor
    clear: Tensor
    said: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        turns_deg_per_s: Sequence[float] = (-45, -30, -15, 0, 15, 30, 45),
        climbs_deg: Sequence[float] = (-20, -10, 0, 10, 20),
        seconds: float = 2.0,
        radius_m: float = 1.0,
        min_speed_mps: float = 5.0,
        phantoms: float = 0.01,
        **kwargs: Any,
    ) -> None:
        for name, value in (("seconds", seconds), ("radius_m", radius_m)):
            if not (math.isfinite(value) and value > 0):
                raise UserError(f"{name}: {value} must be a finite number above 0")
        if not (math.isfinite(min_speed_mps) and min_speed_mps >= 0):
            raise UserError(f"min_speed_mps: {min_speed_mps} must be a finite number, 0 or more")
        for name, angles in (("turns_deg_per_s", turns_deg_per_s), ("climbs_deg", climbs_deg)):
            if not angles or not all(math.isfinite(angle) for angle in angles):
                raise UserError(f"{name}: {list(angles)} must be one finite number or more")
        if not 0 < phantoms < 1:
            raise UserError(f"phantoms: {phantoms} must be between 0 and 1, as 0.01")

        super().__init__(grid, *arguments, **kwargs)
        self.turns_deg_per_s, self.climbs_deg = tuple(turns_deg_per_s), tuple(climbs_deg)
        self.seconds, self.radius_m, self.min_speed_mps = seconds, radius_m, min_speed_mps
        self.phantoms = phantoms
        self.add_tables(blocked=(self.num_classes, BINS), clear=(BINS,), said=(2, 2))

    def frame_tables(
        self,
        preds: F.Preds,
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None = None,
        logits: F.Logits | None = None,
    ) -> Tables:
        """Returns the tables of every frame: primitives that are ``blocked`` [class met first, bin
        of the log-odds], and ``clear`` [bin], where there are logits; and all of them as ``said``
        [truly blocked, called blocked]."""
        codes = self.codes(preds, target, mask)
        F.require_directions(velocity, len(target), "a primitive")
        if preds.is_floating_point():
            logits = preds
        speeds_mps = F.speeds(velocity, batch=len(target))
        scores = [None] * len(codes) if logits is None else logits
        return self.stacked(
            [self._frame(*frame) for frame in zip(codes, scores, velocity, speeds_mps)]
        )

    def scores(self, tables: Tables) -> Scores:
        """Returns the scores of tables as `frame_tables` gives them, summed."""
        blocked, clear, said = (tables[name].double() for name in ("blocked", "clear", "said"))
        called = _called(clear)  # [*n, thresholds]
        found = _called(blocked)  # [*n, class, thresholds]
        found_any = _called(blocked.sum(-2))

        scores = {"primitive_miss": 1 - _at(self.phantoms, called, found_any)}
        for n, name in enumerate(self.class_names):
            if n != self.free_index:
                at = _at(self.phantoms, called, found[..., n, :])
                scores[f"primitive_miss/{name}"] = 1 - at
        scores["primitive_auc"] = torch.trapezoid(found_any, called)
        scores["primitive_miss_argmax"] = said[..., 1, 0] / said[..., 1, :].sum(-1)
        scores["primitive_phantoms_argmax"] = said[..., 0, 1] / said[..., 0, :].sum(-1)
        return scores

    def _frame(
        self,
        codes: UInt8[Tensor, "X Y Z"],
        logits: Float[Tensor, "c X Y Z"] | None,
        velocity_mps: Float[Tensor, "3"],
        speed_mps: float,
    ) -> Tables:
        paths_m = F.primitive_paths(
            velocity_mps,
            max(speed_mps, self.min_speed_mps),
            self.turns_deg_per_s,
            self.climbs_deg,
            self.seconds,
            self.grid.voxel_m / 2,
        )
        swept = F.swept(codes, logits, paths_m, self.radius_m, self.grid, self.free_index)

        truly = swept.met != CLEAR
        outcome = (2 * truly.long() + swept.said)[swept.known]
        tables = {name: torch.zeros(table.shape).long() for name, table in self.tables.items()}
        tables["said"] = torch.bincount(outcome, minlength=4).view(2, 2)
        if logits is not None:
            bins = ((swept.log_odds * BINS_A_UNIT).floor() + BINS // 2).clamp(0, BINS - 1).long()
            cells = (swept.met * BINS + bins)[truly]
            tables["blocked"] = torch.bincount(cells, minlength=self.num_classes * BINS)
            tables["blocked"] = tables["blocked"].view(self.num_classes, BINS)
            tables["clear"] = torch.bincount(bins[swept.known & ~truly], minlength=BINS)
        return tables


def _called(counts: Float[Tensor, "*n bins"]) -> Float[Tensor, "*n thresholds"]:
    """Returns the share at or above each threshold, from the highest, which none reaches, down to
    the lowest, which all do."""
    reached = counts.flip(-1).cumsum(-1)
    return torch.nn.functional.pad(reached, (1, 0)) / counts.sum(-1, keepdim=True)


def _at(
    share: float, called: Float[Tensor, "*n t"], found: Float[Tensor, "*n t"]
) -> Float[Tensor, "*n"]:
    """Returns where the curve of ``found`` by ``called``, both rising, is at a share of the second;
    where it rises steeply, its top."""
    last = ((called <= share).sum(-1, keepdim=True) - 1).clamp(min=0)
    after = (last + 1).clamp(max=called.shape[-1] - 1)
    (x0, x1), (y0, y1) = ([each.gather(-1, i) for i in (last, after)] for each in (called, found))
    between = torch.where(x1 > x0, (share - x0) / (x1 - x0), 0.0)
    value = torch.lerp(y0, y1, between)
    return torch.where(called[..., :1].isnan(), torch.nan, value)[..., 0]
