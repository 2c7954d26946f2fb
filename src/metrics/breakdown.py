"""KAR-mIoU taken apart: which errors, how soon, how far, and seen or not."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pandas as pd
import torch
from jaxtyping import Bool, Float, Int, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import NamedCounts, Scores
from .occupancy import ConfusionMetric

TTC_EDGES_S = (1.0, 2.0, 3.0, 4.0, 5.0)
DISTANCE_EDGES_M = (5.0, 10.0, 25.0)
# The part of space that leaves none out.
WHOLE = "whole"

# ``count`` and ``excess`` of a part of space.
Pair = tuple[F.Confusion, F.Confusion]


class KARBreakdown(ConfusionMetric):
    """The parts of KAR-mIoU, from one pass over every frame.

    Voxels are sorted by their time to collision (``|x| / max(|v|, min_speed_mps)``), by their
    distance from the UAV, and by whether the camera sees them now. `compute` gives a dict of
    scalars in [0, 1]; all are means over the occupied classes, and a class of which there is
    nothing to count in the part of space is left out of its mean. With the scope ``all`` (every
    counted voxel) or ``visible`` (those that ``visible`` holds) before them:

    - ``miou_occupied``, ``kar_miou``, and ``ttc_cost``, their difference: what the weighting by
      time to collision itself took,
    - ``kar_miou_fp`` and ``kar_miou_fn``: KAR-mIoU in which only false positives, or only false
      negatives, weigh more than 1,
    - ``kar_precision`` and ``kar_recall``: TP over TP and penalized FP, or FN, alone; the first
      over the classes that were predicted, the second over those that are there,
    - ``ttc_<a>_<b>s/...``, ``distance_<a>_<b>m/...``, ``within_<b>m/...``: ``miou_occupied`` and
      ``kar_miou`` of the voxels from a to b (b is in, a is not; ``inf`` is no bound).

    It takes the arguments of `KARMeanIoU`, and

    Args:
        ttc_edges_s: bounds of the bins of time to collision, ascending.
        distance_edges_m: bounds of the bins of distance, ascending, and radii of the near ranges.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([0, 0, 5, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 0, 8, 8]).view(1, 4, 1, 1)    # the car 5 m ahead is missed
    >>> parts = KARBreakdown(grid, distance_edges_m=(4.0,))
    >>> parts.update(preds, target, torch.tensor([10.0]), visible=target < 8)
    >>> scores = parts.compute()
    >>> [round(float(scores[f"all/{name}"]), 3) for name in ("kar_miou", "within_4m/kar_miou")]
    [0.5, 1.0]
    """

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        ttc_edges_s: Sequence[float] = TTC_EDGES_S,
        distance_edges_m: Sequence[float] = DISTANCE_EDGES_M,
        **kwargs: Any,
    ) -> None:
        self.ttc_edges_s = _ascending("ttc_edges_s", ttc_edges_s)
        self.distance_edges_m = _ascending("distance_edges_m", distance_edges_m)
        self.sides = (len(self.ttc_edges_s) + 1, len(self.distance_edges_m) + 1)
        self.n_bins = math.prod(self.sides)
        super().__init__(grid, *arguments, parts=(2, self.n_bins), **kwargs)

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of ``count`` and ``excess`` [*n, 2, ttc * distance, c, c]."""
        scores = {}
        for (scope, part), (count, excess) in self._parts(counts).items():
            prefix = scope if part == WHOLE else f"{scope}/{part}"
            occupied = self._mean(F.iou_compute(count))
            kar = self._mean(F.iou_compute(count, excess))
            scores |= {f"{prefix}/miou_occupied": occupied, f"{prefix}/kar_miou": kar}
            if part != WHOLE:
                continue

            of_fp = F.iou_compute(count, excess, false_negatives=False)
            of_fn = F.iou_compute(count, excess, false_positives=False)
            scores |= {
                f"{scope}/ttc_cost": occupied - kar,
                f"{scope}/kar_miou_fp": self._mean(of_fp),
                f"{scope}/kar_miou_fn": self._mean(of_fn),
                f"{scope}/kar_precision": self._mean(F.precision_compute(count, excess)),
                f"{scope}/kar_recall": self._mean(F.recall_compute(count, excess)),
            }
        return scores

    def table(self, counts: NamedCounts | None = None) -> pd.DataFrame:
        """Returns a row for each scope, part of space and class: voxels, IoU and KAR-IoU.

        They are those of everything counted so far, or of other ``counts``.
        """
        rows = []
        for names, (count, excess) in self._parts(counts or self.counts).items():
            columns = (count.sum(-1), F.iou_compute(count), F.iou_compute(count, excess))
            of_classes = zip(self.class_names, *(column.tolist() for column in columns))
            rows += [(*names, *row) for row in of_classes]
        columns = ["scope", "part", "class", "true_voxels", "iou", "kar_iou"]
        return pd.DataFrame(rows, columns=columns)

    def part_of(self, speed_mps: float, visible: Bool[Tensor, "v"]) -> Int[Tensor, "v"]:
        """Returns the bin of every voxel, after all bins for one that is visible."""
        sooner = _bin_of(self.penalty.ttc_s(self.shell_m, speed_mps), self.ttc_edges_s)
        bins = self.sides[1] * sooner + _bin_of(self.shell_m, self.distance_edges_m)
        bins = bins.to(visible.device, torch.int32)
        return bins.index_select(0, self.shell) + self.n_bins * visible.int()

    def _parts(self, counts: NamedCounts) -> dict[tuple[str, str], Pair]:
        """Returns ``count`` and ``excess`` of every scope and part of space."""
        parts = {}
        for scope, seen in {"all": [0, 1], "visible": [1]}.items():
            # Visible voxels are the second half of the counts.
            of_scope = [counts[name][..., seen, :, :, :].sum(-4) for name in ("count", "excess")]
            for part, bins in self._bins_of_parts().items():
                parts[scope, part] = tuple(each[..., bins, :, :].sum(-3) for each in of_scope)
        return parts

    def _bins_of_parts(self) -> dict[str, Bool[Tensor, "k"]]:
        """Returns which bins belong to the whole, and to every part of space."""
        ttc, distance = torch.unravel_index(torch.arange(self.n_bins), self.sides)
        parts = {WHOLE: ttc >= 0}
        for n, (lower, upper) in enumerate(pairwise([0.0, *self.ttc_edges_s, math.inf])):
            parts[f"ttc_{lower:g}_{upper:g}s"] = ttc == n
        for n, (lower, upper) in enumerate(pairwise([0.0, *self.distance_edges_m, math.inf])):
            parts[f"distance_{lower:g}_{upper:g}m"] = distance == n
        for n, edge in enumerate(self.distance_edges_m):
            parts[f"within_{edge:g}m"] = distance <= n
        return parts

    def _mean(self, of_classes: Float[Tensor, "*n c"]) -> Float[Tensor, "*n"]:
        return F.mean_iou(of_classes, without=self.free_index)


def _bin_of(values: Float[Tensor, "s"], edges: Sequence[float]) -> Int64[Tensor, "s"]:
    """Returns the bin of each value; a value on an edge belongs below it, as the horizon does."""
    return torch.searchsorted(torch.tensor(edges, dtype=values.dtype), values.contiguous())


def _ascending(name: str, edges: Sequence[float]) -> tuple[float, ...]:
    edges = tuple(map(float, edges))
    is_ascending = all(a < b for a, b in pairwise((0.0, *edges, math.inf)))
    if not edges or not is_ascending:
        raise UserError(f"{name}: {list(edges)} must be ascending numbers above 0")
    return edges
