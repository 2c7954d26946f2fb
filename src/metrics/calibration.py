"""Whether the probabilities mean what they say, where it matters."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .occupancy import class_names
from .tables import Scores, TableMetric, Tables

VOXELS, HITS, CONFIDENCE = range(3)
FIXED_POINT = 2**20
"""Confidences and log-likelihoods are summed as multiples of its inverse: exact in any order."""

LARGEST_NLL = 64.0
"""A voxel's NLL is cut off here, a probability of 1e-28, so that no sum overflows."""


class Calibration(TableMetric):
    """Expected calibration error and negative log-likelihood inside the reachable bubble.

    Every known voxel within ``max(|v|, min_speed_mps) * horizon_s`` of the UAV counts once.
    `compute` gives a dict of scalars:

    - ``ece``: voxels are sorted into ``bins`` equal bins by the probability of their predicted
      class; ``sum over bins of n_bin / n * |accuracy_bin - mean probability_bin|``,
    - ``ece/<class>``: the same over the voxels that were predicted to be of that class,
    - ``nll``: mean of ``-log p(true class)`` in nats, and ``nll/<class>`` over the voxels of a
      class.

    A class that was never predicted, or never true, is NaN. Takes logits only.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([1, 1, 1, 0]).view(1, 4, 1, 1)
    >>> logits = torch.tensor([0.25, 0.75]).log().view(1, 2, 1, 1, 1).expand(1, 2, 4, 1, 1)
    >>> calibration = Calibration(grid, num_classes=2)         # says 75 %, and 75 % it is
    >>> calibration.update(logits, target, velocity=torch.tensor([10.0]))
    >>> float(calibration.compute()["ece"])
    0.0
    """

    higher_is_better = False
    reliability: Tensor
    likelihood: Tensor
    shell: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        ignore_index: int = 255,
        horizon_s: float = 5.0,
        min_speed_mps: float = 5.0,
        bins: int = 15,
        **kwargs: Any,
    ) -> None:
        F.check_classes(num_classes, ignore_index)
        if bins < 1:
            raise UserError(f"bins: {bins} must be 1 or more")
        shapes = {"reliability": (num_classes, bins, 3), "likelihood": (num_classes, 2)}
        super().__init__(shapes, **kwargs)
        self.grid, self.num_classes, self.ignore_index = grid, num_classes, ignore_index
        self.bubble = F.Penalty(horizon_s=horizon_s, min_speed_mps=min_speed_mps)
        self.bins = bins
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)

    def frame_tables(
        self,
        logits: Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Tables:
        """``reliability`` [predicted class, bin, (voxels, right, sum of probabilities)] and
        ``likelihood`` [true class, (voxels, sum of NLL)] of every frame."""
        if not logits.is_floating_point():
            raise UserError(f"preds: calibration needs logits, and {logits.dtype} are labels")
        F.check_shapes(logits, target, {"mask": mask}, self.grid.shape, self.num_classes)
        if logits.isnan().any():
            raise UserError("preds: the logits hold NaN; look for a loss that diverged")
        # Refuses the same targets as the other metrics, also beyond the bubble.
        F.encode(torch.zeros_like(target), target, mask, self.num_classes, self.ignore_index)
        speeds_mps = F.speeds(velocity, batch=len(target))
        tables = [
            self._frame(logits[n], target[n], None if mask is None else mask[n], speed_mps)
            for n, speed_mps in enumerate(speeds_mps)
        ]
        empty = [table.new_zeros(0, *table.shape) for table in self.tables.values()]
        stacked = [torch.stack(rows) for rows in zip(*tables)] or empty
        return dict(zip(self.shapes, stacked))

    def scores(self, tables: Tables) -> Scores:
        """The scores of tables as `frame_tables` gives them, summed."""
        reliability, likelihood = (tables[name].double() for name in self.shapes)
        nll = likelihood[..., 1] / FIXED_POINT
        voxels = likelihood[..., 0]
        whole = reliability.sum(-3)
        scores = {"ece": _ece(whole), "nll": nll.sum(-1) / voxels.sum(-1)}
        names = class_names(self.num_classes)
        by_class = _ece(reliability)
        scores |= {f"ece/{name}": by_class[..., n] for n, name in enumerate(names)}
        scores |= {f"nll/{name}": (nll / voxels)[..., n] for n, name in enumerate(names)}
        return scores

    def _frame(
        self,
        logits: Float[Tensor, "c X Y Z"],
        target: Int[Tensor, "X Y Z"],
        mask: Bool[Tensor, "X Y Z"] | None,
        speed_mps: float,
    ) -> tuple[Int64[Tensor, "c bins 3"], Int64[Tensor, "c 2"]]:
        near = (self.bubble.ttc_s(self.shell_m, speed_mps) <= self.bubble.horizon_s).sum()
        known = (target.flatten() != self.ignore_index) & (self.shell < near.item())
        if mask is not None:
            known &= mask.flatten()
        voxels = torch.nonzero(known).squeeze(1)
        truth = target.flatten()[voxels].long()
        log_p = logits.detach().flatten(1).index_select(1, voxels).double().log_softmax(dim=0)
        if log_p.isnan().any():  # of infinities
            raise UserError("preds: the logits hold infinities; look for a loss that diverged")
        return self._reliability(log_p, truth), self._likelihood(log_p, truth)

    def _reliability(
        self, log_p: Float[Tensor, "c n"], truth: Int64[Tensor, "n"]
    ) -> Int64[Tensor, "c bins 3"]:
        highest, predicted = log_p.max(dim=0)
        confidence = highest.exp()
        bin_ = (confidence * self.bins).long().clamp(max=self.bins - 1)
        columns = torch.ones(len(truth), 3, dtype=torch.int64, device=truth.device)
        columns[:, HITS] = predicted == truth
        columns[:, CONFIDENCE] = torch.round(confidence * FIXED_POINT).long()
        table = columns.new_zeros(self.num_classes * self.bins, 3)
        table.index_add_(0, predicted * self.bins + bin_, columns)
        return table.view(self.num_classes, self.bins, 3)

    def _likelihood(
        self, log_p: Float[Tensor, "c n"], truth: Int64[Tensor, "n"]
    ) -> Int64[Tensor, "c 2"]:
        nll = -log_p.gather(0, truth[None])[0].clamp(min=-LARGEST_NLL)
        columns = torch.ones(len(truth), 2, dtype=torch.int64, device=truth.device)
        columns[:, 1] = torch.round(nll * FIXED_POINT).long()
        return columns.new_zeros(self.num_classes, 2).index_add_(0, truth, columns)


def _ece(reliability: Float[Tensor, "*n bins 3"]) -> Float[Tensor, "*n"]:
    gap = reliability[..., HITS] - reliability[..., CONFIDENCE] / FIXED_POINT
    return gap.abs().sum(-1) / reliability[..., VOXELS].sum(-1)
