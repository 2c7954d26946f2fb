"""Calibration of the predicted probabilities, within the bubble."""

from typing import Any

import torch
from jaxtyping import Float, Int64, UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import NamedCounts, Scores, VoxelMetric
from .functional.codes import UNCOUNTED

# The columns of ``reliability``.
VOXELS, HITS, CONFIDENCE = range(3)

# Confidences and log-likelihoods are summed as multiples of its inverse: exact in any order.
FIXED_POINT = 2**20

# A voxel's NLL is cut off here, a probability of 1e-28, so that no sum overflows.
LARGEST_NLL = 64.0


class Calibration(VoxelMetric):
    """Expected calibration error and negative log-likelihood inside the reachable bubble.

    Every known voxel within ``max(|v|, min_speed_mps) * horizon_s`` of the UAV counts once.
    `compute` gives a dict of scalars:

    - ``ece``: voxels are sorted into ``bins`` equal bins by the probability of their predicted
      class; ``sum over bins of n_bin / n * |accuracy_bin - mean probability_bin|``,
    - ``ece/<class>``: that sum over the voxels that were predicted to be of the class,
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

    knows_free = False

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        ignore_index: int | None = 255,
        horizon_s: float = 5.0,
        min_speed_mps: float = 5.0,
        bins: int = 15,
        **kwargs: Any,
    ) -> None:
        if bins < 1:
            raise UserError(f"bins: {bins} must be 1 or more")

        super().__init__(grid, num_classes, ignore_index=ignore_index, **kwargs)
        self.add_counts(reliability=(num_classes, bins, 3), likelihood=(num_classes, 2))
        self.bubble = F.Penalty(horizon_s=horizon_s, min_speed_mps=min_speed_mps)
        self.bins = bins

    def frame_counts(
        self, logits: F.Logits, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> NamedCounts:
        """Returns ``reliability`` [predicted class, bin, (voxels, right, sum of probabilities)] and
        ``likelihood`` [true class, (voxels, sum of NLL)] of every frame."""
        if not logits.is_floating_point():
            raise UserError(f"preds: calibration needs logits, and {logits.dtype} are labels")
        # Refuses what the other metrics refuse, also beyond the bubble.
        codes = self.codes(logits, target, mask).flatten(1)
        speeds_mps = F.speeds(velocity, batch=len(target))
        return self.stacked([self._frame(*frame) for frame in zip(logits, codes, speeds_mps)])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        reliability, likelihood = counts["reliability"].double(), counts["likelihood"].double()
        voxels, nll = likelihood[..., 0], likelihood[..., 1] / FIXED_POINT
        return {
            "ece": _ece(reliability.sum(-3)),
            "nll": nll.sum(-1) / voxels.sum(-1),
            **self.of_classes("ece", _ece(reliability)),
            **self.of_classes("nll", nll / voxels),
        }

    def _frame(
        self, logits: Float[Tensor, "c X Y Z"], codes: UInt8[Tensor, "v"], speed_mps: float
    ) -> NamedCounts:
        # Distances ascend, so the bubble is the first so many of them.
        near = (self.bubble.ttc_s(self.shell_m, speed_mps) <= self.bubble.horizon_s).sum()
        voxels = torch.nonzero((codes != UNCOUNTED) & (self.shell < near.item())).squeeze(1)
        true = codes[voxels].long() >> 4

        log_p = logits.detach().flatten(1).index_select(1, voxels).double().log_softmax(dim=0)
        if log_p.isnan().any():  # of infinities
            raise UserError("preds: the logits hold infinities; look for a loss that diverged")
        highest, predicted = log_p.max(dim=0)
        confidence = highest.exp()
        nll = -log_p.gather(0, true[None])[0].clamp(min=-LARGEST_NLL)

        bin_ = (confidence * self.bins).long().clamp(max=self.bins - 1)
        cells = predicted * self.bins + bin_
        reliability, likelihood = map(torch.zeros_like, self.counts.values())
        _add(reliability.flatten(0, 1), cells, predicted == true, confidence * FIXED_POINT)
        _add(likelihood, true, nll * FIXED_POINT)
        return {"reliability": reliability, "likelihood": likelihood}


def _add(count: Int64[Tensor, "t k"], rows: Int64[Tensor, "n"], *columns: Tensor) -> None:
    """Adds one to the first column of these rows of a count, and the columns to the others."""
    whole = [column.double().round().long() for column in columns]
    count.index_add_(0, rows, torch.stack([torch.ones_like(rows), *whole], dim=1))


def _ece(reliability: Float[Tensor, "*n bins 3"]) -> Float[Tensor, "*n"]:
    gap = reliability[..., HITS] - reliability[..., CONFIDENCE] / FIXED_POINT
    return gap.abs().sum(-1) / reliability[..., VOXELS].sum(-1)
