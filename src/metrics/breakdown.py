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
from .confusion import PenalizedConfusion
from .occupancy import class_names
from .tables import Scores, Tables

TTC_EDGES_S = (1.0, 2.0, 3.0, 4.0, 5.0)
DISTANCE_EDGES_M = (5.0, 10.0, 25.0)
SCOPES = ("all", "visible")


class KARBreakdown(PenalizedConfusion):
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

    Arguments as of `KARMeanIoU`, and

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
        super().__init__(
            grid,
            *arguments,
            n_bins=(len(self.ttc_edges_s) + 1) * (len(self.distance_edges_m) + 1),
            by_mark=True,
            **kwargs,
        )

    def frame_tables(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
        visible: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Tables:
        """``count`` and ``excess`` of every frame, [b, 2, ttc * distance, c, c]; without
        ``visible`` nothing is."""
        if visible is None:
            visible = torch.zeros_like(target, dtype=torch.bool)
        return super().frame_tables(preds, target, velocity, mask, visible)

    def scores(self, tables: Tables) -> Scores:
        """The scores of tables ``count`` and ``excess`` [*n, 2, ttc * distance, c, c]."""
        scores = {}
        for scope, both in self._scopes(tables).items():
            scores |= {f"{scope}/{name}": score for name, score in self._whole(both).items()}
            for part, (count, excess) in self._parts(both).items():
                occupied, kar = self._means(count, excess)
                scores[f"{scope}/{part}/miou_occupied"] = occupied
                scores[f"{scope}/{part}/kar_miou"] = kar
        return scores

    def table(self, tables: Tables | None = None) -> pd.DataFrame:
        """A row for each scope, part of space and class: voxels, IoU and KAR-IoU.

        Of what was counted so far, or of other ``tables``.
        """
        rows = []
        names = class_names(self.num_classes)
        for scope, both in self._scopes(tables or self.tables).items():
            parts = {"whole": tuple(table.sum((-4, -3)) for table in both), **self._parts(both)}
            for part, (count, excess) in parts.items():
                iou, kar_iou = F.iou_compute(count), F.iou_compute(count, excess)
                voxels = count.sum(-1)
                rows += [
                    (scope, part, name, int(voxels[n]), float(iou[n]), float(kar_iou[n]))
                    for n, name in enumerate(names)
                ]
        columns = ["scope", "part", "class", "true_voxels", "iou", "kar_iou"]
        return pd.DataFrame(rows, columns=columns)

    def _bins(self, speeds_mps: list[float]) -> Int[Tensor, "b s"]:
        farther = _bin_of(self.shell_m, self.distance_edges_m)
        stride = len(self.distance_edges_m) + 1
        rows = [
            stride * _bin_of(self.penalty.ttc_s(self.shell_m, speed), self.ttc_edges_s) + farther
            for speed in speeds_mps
        ]
        empty = farther.new_empty(0, len(farther))
        return (torch.stack(rows) if rows else empty).to(self.shell.device)

    def _scopes(
        self, tables: Tables
    ) -> dict[str, tuple[Int64[Tensor, "*n t d c c"], Int64[Tensor, "*n t d c c"]]]:
        """Both tables with time and distance apart, of all voxels and of the visible ones."""
        sides = (len(self.ttc_edges_s) + 1, len(self.distance_edges_m) + 1)
        both = tuple(tables[name].unflatten(-3, sides) for name in ("count", "excess"))
        seen = tuple(table.select(-5, 1) for table in both)
        return dict(zip(SCOPES, (tuple(table.sum(-5) for table in both), seen)))

    def _whole(self, both: tuple[Tensor, Tensor]) -> Scores:
        count, excess = (table.sum((-4, -3)) for table in both)
        occupied, kar = self._means(count, excess)
        return {
            "miou_occupied": occupied,
            "kar_miou": kar,
            "ttc_cost": occupied - kar,
            "kar_miou_fp": self._mean(F.iou_compute(count, excess, false_negatives=False)),
            "kar_miou_fn": self._mean(F.iou_compute(count, excess, false_positives=False)),
            "kar_precision": self._mean(F.precision_compute(count, excess)),
            "kar_recall": self._mean(F.recall_compute(count, excess)),
        }

    def _parts(self, both: tuple[Tensor, Tensor]) -> dict[str, tuple[Tensor, Tensor]]:
        """Both tables [*n, c, c] of every part of space."""
        by_ttc, by_distance = ([table.sum(dim) for table in both] for dim in (-3, -4))
        parts = {}
        for kind, unit, edges, tables in (
            ("ttc", "s", self.ttc_edges_s, by_ttc),
            ("distance", "m", self.distance_edges_m, by_distance),
        ):
            bounds = [0.0, *edges, float("inf")]
            for n, (lower, upper) in enumerate(pairwise(bounds)):
                name = f"{kind}_{lower:g}_{upper:g}{unit}"
                parts[name] = tuple(table.select(-3, n) for table in tables)
        for n, edge in enumerate(self.distance_edges_m):
            near = tuple(table[..., : n + 1, :, :].sum(-3) for table in by_distance)
            parts[f"within_{edge:g}m"] = near
        return parts

    def _means(self, count: Tensor, excess: Tensor) -> tuple[Tensor, Tensor]:
        return self._mean(F.iou_compute(count)), self._mean(F.iou_compute(count, excess))

    def _mean(self, of_classes: Float[Tensor, "*n c"]) -> Float[Tensor, "*n"]:
        return F.mean_iou(of_classes, without=self.free_index)


def _bin_of(values: Float[Tensor, "s"], edges: Sequence[float]) -> Int64[Tensor, "s"]:
    """Which bin each value lies in; a value on an edge belongs below it, as the horizon does."""
    return torch.searchsorted(torch.tensor(edges, dtype=values.dtype), values.contiguous())


def _ascending(name: str, edges: Sequence[float]) -> tuple[float, ...]:
    edges = tuple(map(float, edges))
    ascending = all(a < b for a, b in pairwise((0.0, *edges, math.inf)))
    if not edges or not ascending:
        raise UserError(f"{name}: {list(edges)} must be ascending numbers above 0")
    return edges
