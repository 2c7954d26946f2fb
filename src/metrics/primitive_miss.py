"""Whether the paths that the UAV could fly next are blocked, and whether the prediction says so."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import NamedCounts, Scores
from .functional.codes import NOTHING
from .primitives import PrimitiveMetric

# The log-odds that a path is blocked are sorted into bins of an eighth, from -16 to 16.
BINS, BINS_A_UNIT = 256, 8


class PrimitiveMiss(PrimitiveMetric):
    """Blocked motion primitives that the prediction calls free.

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

    The first three take logits, and are NaN for labels. It takes the arguments of
    `PrimitiveMetric`. Raises `UserError` also for a share outside 0 to 1.

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
        self, grid: VoxelGrid, *arguments: Any, phantoms: float = 0.01, **kwargs: Any
    ) -> None:
        if not 0 < phantoms < 1:
            raise UserError(f"phantoms: {phantoms} must be between 0 and 1, as 0.01")

        super().__init__(grid, *arguments, **kwargs)
        self.phantoms = phantoms
        self.add_counts(blocked=(self.num_classes, BINS), clear=(BINS,), said=(2, 2))

    def frame_counts(
        self,
        preds: F.Preds,
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None = None,
        logits: F.Logits | None = None,
    ) -> NamedCounts:
        """Returns the counts of every frame: primitives that are ``blocked`` [class met first, bin
        of the log-odds], and ``clear`` [bin], where there are logits; and all of them as ``said``
        [truly blocked, called blocked]."""
        if preds.is_floating_point():
            logits = preds
        swept = self.swept(preds, target, velocity, mask, logits)
        return self.stacked([self._frame(each, logits is not None) for each in swept])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        blocked, clear, said = (counts[name].double() for name in ("blocked", "clear", "said"))
        called = _called(clear)  # [*n, thresholds]
        found = _called(blocked)  # [*n, class, thresholds]
        found_any = _called(blocked.sum(-2))

        missed = 1 - _at(self.phantoms, called[..., None, :].expand_as(found), found)
        return {
            "primitive_miss": 1 - _at(self.phantoms, called, found_any),
            **self.of_classes("primitive_miss", missed, without=[self.free_index]),
            "primitive_auc": torch.trapezoid(found_any, called),
            "primitive_miss_argmax": said[..., 1, 0] / said[..., 1, :].sum(-1),
            "primitive_phantoms_argmax": said[..., 0, 1] / said[..., 0, :].sum(-1),
        }

    def _frame(self, swept: F.Swept, has_logits: bool) -> NamedCounts:
        truly = swept.met != NOTHING
        outcome = (2 * truly.long() + swept.said)[swept.known]
        said = torch.bincount(outcome, minlength=4).view(2, 2)

        # Without logits no path has odds.
        bins = ((swept.log_odds * BINS_A_UNIT).floor() + BINS // 2).clamp(0, BINS - 1).long()
        cells = (swept.met * BINS + bins)[truly & has_logits]
        blocked = torch.bincount(cells, minlength=self.num_classes * BINS).view(-1, BINS)
        clear = torch.bincount(bins[swept.known & ~truly & has_logits], minlength=BINS)
        return {"blocked": blocked, "clear": clear, "said": said}


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
