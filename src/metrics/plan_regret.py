"""Regret of a planner that plans from the prediction instead of the truth, frame by frame."""

from typing import Any

import torch
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import NamedCounts, Scores
from .functional.codes import NOTHING
from .primitives import PrimitiveMetric


class PlanRegret(PrimitiveMetric):
    """The open-loop regret of a planner that chooses among motion primitives.

    A primitive costs how far from flying straight on it ends, as a share of the length flown, so
    stopping costs 1. The planner takes the cheapest primitive that is clear, or stops: by the
    prediction, in which one is clear if no voxel in it is predicted occupied, and by the truth.
    A choice that is truly blocked costs ``collision``. `compute` gives

    - ``plan_regret``: what the choice by the prediction costs beyond the one by the truth, as a
      mean over frames,
    - ``unsafe_plan_rate``: the share of frames in which it is truly blocked,
    - ``needless_stop_rate``: the share, of frames in which the truth leaves a way, in which it is
      to stop.

    It takes the arguments of `PrimitiveMetric`. Raises `UserError` also where a collision would
    cost no more than a stop. After PKL (Philion, Kar and Fidler, CVPR 2020).

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 3, 8]).view(1, 4, 1, 1)
    >>> ahead = PlanRegret(grid, turns_deg_per_s=[0.0], climbs_deg=[0.0])
    >>> ahead.update(torch.full_like(target, 8), target, velocity=torch.tensor([[5.0, 0.0, 0.0]]))
    >>> float(ahead.compute()["plan_regret"])    # into the wire, instead of stopping
    1.0
    """

    higher_is_better = False
    chosen: Tensor

    def __init__(
        self, grid: VoxelGrid, *arguments: Any, collision: float = 2.0, **kwargs: Any
    ) -> None:
        if not collision > 1:
            raise UserError(f"collision: {collision} must be above 1, which a stop costs")
        super().__init__(grid, *arguments, **kwargs)
        self.collision = collision
        # Of every primitive, and of a stop, with a path of unit length.
        ahead = torch.tensor([1.0, 0.0, 0.0])
        off = torch.from_numpy(self.paths(ahead, 1 / self.seconds, step_m=1.0)[:, -1]) - ahead
        self.costs = torch.cat([off.norm(dim=-1), torch.ones(1)])
        self.add_counts(chosen=(len(self.costs), len(self.costs), 2))

    def frame_counts(
        self, preds: F.Preds, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> NamedCounts:
        """Returns of every frame what was ``chosen`` [by the prediction, by the truth, whether the
        first is truly blocked]; the last choice is to stop. Frames of which no primitive has a
        label have zeros."""
        swept = self.swept(preds, target, velocity, mask)
        return self.stacked([{"chosen": self._frame(each)} for each in swept])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        chosen = counts["chosen"].double()
        costs = self.costs.to(chosen.device)
        frames = chosen.sum((-3, -2, -1))
        by_prediction = (chosen[..., 0].sum(-1) * costs).sum(-1)
        by_prediction += self.collision * chosen[..., 1].sum((-2, -1))
        by_truth = (chosen.sum((-3, -1)) * costs).sum(-1)
        with_a_way = chosen[..., :-1, :].sum(-1)
        return {
            "plan_regret": (by_prediction - by_truth) / frames,
            "unsafe_plan_rate": chosen[..., 1].sum((-2, -1)) / frames,
            "needless_stop_rate": with_a_way[..., -1, :].sum(-1) / with_a_way.sum((-2, -1)),
        }

    def _frame(self, swept: F.Swept) -> Tensor:
        chosen = torch.zeros(self.chosen.shape, dtype=torch.int64)
        if not swept.known.any():
            return chosen
        blocked = swept.met != NOTHING
        by_prediction = self._cheapest(swept.known & ~swept.said)
        by_truth = self._cheapest(swept.known & ~blocked)
        hit = by_prediction < len(blocked) and bool(blocked[by_prediction])
        chosen[by_prediction, by_truth, int(hit)] = 1
        return chosen

    def _cheapest(self, clear: Tensor) -> int:
        """Returns which of the clear primitives is the cheapest, or the number of all, for a
        stop."""
        costs = torch.where(clear, self.costs[:-1], self.costs[-1])
        best = int(costs.argmin())
        return best if clear[best] else len(clear)
