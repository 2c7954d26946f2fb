"""Calibration of the probability of occupied, over the bubble and in the tube ahead."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_finite
from . import functional as F
from .count_metric import OUR_GROUND, NamedCounts, Scores, VoxelMetric
from .functional.codes import UNCOUNTED
from .safety import swept_tube

# Probabilities are counted by their log-odds, in bins of a tenth of a nat; the last ones are open.
STEP, MOST = 0.1, 10.0
BINS = round(2 * MOST / STEP) + 2
# Probabilities and squared errors are summed as multiples of its inverse: exact in any order.
FIXED_POINT = 2**20
# The columns of ``bubble`` and ``tube``.
VOXELS, OCCUPIED, PROBABILITY, SQUARED_ERROR = range(4)


class OccupiedCalibration(VoxelMetric):
    """How often what is called occupied with a probability is occupied, whatever its class.

    The bubble is that of `Calibration`, the tube that of `SafetyScores`. `compute` gives a dict of
    scalars:

    - ``occupied_ece`` and ``tube_ece``: the expected calibration error over ``bins`` bins of equal
      mass, ``sum over bins of n_bin / n * |share occupied - mean probability|``,
    - ``occupied_brier`` and ``tube_brier``: the mean of ``(probability - occupied)^2``.

    Its counts hold more: ``bubble`` and ``tube`` [bin of log-odds, (voxels, occupied, sum of
    probabilities, sum of squared errors)], from which reliability diagrams are drawn, and
    ``objects`` [bin of log-odds]: the objects of the tube (as in `ObjectMiss`), by the highest
    probability within ``tolerance_m`` of them. `edges` are the probabilities between the bins.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 8, 0]).view(1, 4, 1, 1)
    >>> metric = OccupiedCalibration(grid)
    >>> metric.update(torch.full((1, 4, 1, 1), 0.25), target, velocity=torch.tensor([[5.0, 0, 0]]))
    >>> float(metric.compute()["occupied_ece"])
    0.0
    """

    higher_is_better = False
    bubble: Tensor
    tube: Tensor
    objects: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        horizon_s: float = 5.0,
        min_speed_mps: float = 5.0,
        tube_radius_m: float = 1.0,
        tube_s: float = 2.0,
        tolerance_m: float = 0.5,
        bins: int = 15,
        ground_index: int = OUR_GROUND,
        **kwargs: Any,
    ) -> None:
        require_finite("tube_radius_m", tube_radius_m)
        require_finite("tube_s", tube_s)
        require_finite("tolerance_m", tolerance_m, zero=True)
        if bins < 1:
            raise UserError(f"bins: {bins} must be 1 or more")

        super().__init__(grid, *arguments, **kwargs)
        self.require_said("ground_index", ground_index, "the ground")
        self.add_counts(bubble=(BINS, 4), tube=(BINS, 4), objects=(BINS,))
        self.penalty = F.Penalty(horizon_s=horizon_s, min_speed_mps=min_speed_mps)
        self.tube_radius_m, self.tube_s = tube_radius_m, tube_s
        self.tolerance_m, self.bins, self.ground_index = tolerance_m, bins, ground_index

    def frame_counts(
        self,
        occupied: Float[Tensor, "b X Y Z"],
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None = None,
    ) -> NamedCounts:
        """Returns the counts of every frame from its probabilities of occupied.

        Raises `UserError` for what is no probability, and for speeds: the tube needs a direction.
        """
        if not ((occupied >= 0) & (occupied <= 1)).all():
            raise UserError("occupied: holds NaN, or what is no probability; look at the network")

        said = torch.where(occupied > 0.5, self.ground_index, self.free_index)
        codes = self.codes(said, target, mask)
        speeds_mps = F.speeds(velocity, len(target), directed="the tube")
        frames = zip(occupied.double(), codes, velocity, speeds_mps)
        return self.stacked([self._frame(*frame) for frame in frames])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        scores = {}
        for name, part in (("occupied", "bubble"), ("tube", "tube")):
            each = counts[part].double()
            scores[f"{name}_ece"] = self._ece(each)
            error = each[..., SQUARED_ERROR].sum(-1) / FIXED_POINT
            scores[f"{name}_brier"] = error / each[..., VOXELS].sum(-1)
        return scores

    def equal_mass(self, counts: Float[Tensor, "*n bins 4"]) -> Float[Tensor, "*n few 4"]:
        """Returns counts in ``self.bins`` bins of about equal mass: those of log-odds, joined."""
        voxels = counts[..., VOXELS]
        middle = voxels.cumsum(-1) - voxels / 2
        share = middle / voxels.sum(-1, keepdim=True).clamp(min=1)
        place = (share * self.bins).long().clamp(max=self.bins - 1)
        joined = counts.new_zeros(*counts.shape[:-2], self.bins, 4)
        return joined.scatter_add_(-2, place[..., None].expand(counts.shape), counts)

    def _ece(self, counts: Float[Tensor, "*n bins 4"]) -> Float[Tensor, "*n"]:
        few = self.equal_mass(counts)
        gap = few[..., OCCUPIED] - few[..., PROBABILITY] / FIXED_POINT
        return gap.abs().sum(-1) / few[..., VOXELS].sum(-1)

    def _frame(
        self,
        occupied: Float[Tensor, "X Y Z"],
        codes: F.Codes,
        velocity_mps: F.Vector,
        speed_mps: float,
    ) -> NamedCounts:
        level = level_of(occupied)
        reached = self.penalty.ttc_s(self.shell_m, speed_mps) <= self.penalty.horizon_s
        in_bubble = reached.to(codes.device)[self.shell.long()].view(codes.shape)

        box, inside = swept_tube(self.grid, velocity_mps, self.tube_s, self.tube_radius_m)
        in_tube = torch.zeros_like(in_bubble)
        in_tube[box] = inside.to(codes.device)

        known = codes != UNCOUNTED
        return {
            "bubble": self._histogram(occupied, codes, level, known & in_bubble),
            "tube": self._histogram(occupied, codes, level, known & in_tube),
            "objects": self._objects(codes, level, in_tube),
        }

    def _histogram(
        self, occupied: Tensor, codes: Tensor, level: Tensor, chosen: Tensor
    ) -> Int64[Tensor, "bins 4"]:
        truly = ((codes[chosen] >> 4) != self.free_index).double()
        said = occupied[chosen]
        columns = [torch.ones_like(said), truly, said * FIXED_POINT]
        columns.append((said - truly).square() * FIXED_POINT)
        counts = torch.zeros_like(self.bubble)
        return counts.index_add_(0, level[chosen], torch.stack(columns, dim=1).round().long())

    def _objects(self, codes: Tensor, level: Tensor, in_tube: Tensor) -> Int64[Tensor, "bins"]:
        # Only here: importing the compiler takes a second.
        from .functional.kernels import count_objects

        around = F.within(self.tolerance_m / self.grid.voxel_m)
        objects = np.zeros((self.num_classes, BINS), np.int64)
        arrays = (each.cpu().contiguous().numpy() for each in (codes, level.short(), in_tube))
        count_objects(*arrays, around, self.free_index, self.ground_index, objects)
        return torch.from_numpy(objects.sum(axis=0))


def level_of(occupied: Float[Tensor, "*n"]) -> Int64[Tensor, "*n"]:
    """Returns the bin of a probability, by its log-odds."""
    place = (torch.logit(occupied.double()) / STEP + BINS / 2).floor()
    return place.clamp(0, BINS - 1).long()


def edges() -> Float[Tensor, "edges"]:
    """Returns the probabilities between the bins."""
    return torch.sigmoid(torch.linspace(-MOST, MOST, BINS - 1, dtype=torch.float64))
