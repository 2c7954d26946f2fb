"""KAR-mIoU taken apart: which errors, how soon, how far, and seen or not."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pandas as pd
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .confusion import PenalizedConfusion
from .tables import Scores, Tables

TTC_EDGES_S = (1.0, 2.0, 3.0, 4.0, 5.0)
DISTANCE_EDGES_M = (5.0, 10.0, 25.0)

# The tables ``count`` and ``excess`` of a part of space.
Pair = tuple[Int64[Tensor, "*n c c"], Int64[Tensor, "*n c c"]]


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
        super().__init__(grid, *arguments, n_bins=math.prod(self.sides), by_visible=True, **kwargs)

    def scores(self, tables: Tables) -> Scores:
        """Returns the scores of tables ``count`` and ``excess`` [*n, 2, ttc * distance, c, c]."""
        scores = {}
        for scope, parts in self._scopes(tables).items():
            count, excess = parts.pop("whole")
            occupied, kar = self._mean(count), self._mean(count, excess)
            whole = {
                "miou_occupied": occupied,
                "kar_miou": kar,
                "ttc_cost": occupied - kar,
                "kar_miou_fp": self._mean(count, excess, false_negatives=False),
                "kar_miou_fn": self._mean(count, excess, false_positives=False),
                "kar_precision": self._occupied(F.precision_compute(count, excess)),
                "kar_recall": self._occupied(F.recall_compute(count, excess)),
            }
            scores |= {f"{scope}/{name}": score for name, score in whole.items()}

            for part, (count, excess) in parts.items():
                scores[f"{scope}/{part}/miou_occupied"] = self._mean(count)
                scores[f"{scope}/{part}/kar_miou"] = self._mean(count, excess)
        return scores

    def table(self, tables: Tables | None = None) -> pd.DataFrame:
        """Returns a row for each scope, part of space and class: voxels, IoU and KAR-IoU.

        They are those of everything counted so far, or of other ``tables``.
        """
        rows = []
        for scope, parts in self._scopes(tables or self.tables).items():
            for part, (count, excess) in parts.items():
                columns = (count.sum(-1), F.iou_compute(count), F.iou_compute(count, excess))
                of_classes = zip(self.class_names, *(column.tolist() for column in columns))
                rows += [(scope, part, *row) for row in of_classes]
        columns = ["scope", "part", "class", "true_voxels", "iou", "kar_iou"]
        return pd.DataFrame(rows, columns=columns)

    def _bins(self, speed_mps: float) -> Int64[Tensor, "s"]:
        sooner = _bin_of(self.penalty.ttc_s(self.shell_m, speed_mps), self.ttc_edges_s)
        return self.sides[1] * sooner + _bin_of(self.shell_m, self.distance_edges_m)

    def _scopes(self, tables: Tables) -> dict[str, dict[str, Pair]]:
        """Returns the tables of every part of space, of all voxels and of the visible ones."""
        # [*n, 2, t, d, c, c]: not visible and visible, by time to collision and distance.
        apart = [tables[name].unflatten(-3, self.sides) for name in ("count", "excess")]
        return {
            "all": self._parts([table.sum(-5) for table in apart]),
            "visible": self._parts([table.select(-5, 1) for table in apart]),
        }

    def _parts(self, apart: list[Int64[Tensor, "*n t d c c"]]) -> dict[str, Pair]:
        """Returns the tables of the whole, of every bin, and of every near range."""
        by_ttc, by_distance = ([table.sum(dim) for table in apart] for dim in (-3, -4))
        parts = {"whole": tuple(table.sum((-4, -3)) for table in apart)}
        for kind, unit, edges, tables in (
            ("ttc", "s", self.ttc_edges_s, by_ttc),
            ("distance", "m", self.distance_edges_m, by_distance),
        ):
            for n, (lower, upper) in enumerate(pairwise([0.0, *edges, math.inf])):
                name = f"{kind}_{lower:g}_{upper:g}{unit}"
                parts[name] = tuple(table.select(-3, n) for table in tables)

        for n, edge in enumerate(self.distance_edges_m):
            near = tuple(table[..., : n + 1, :, :].sum(-3) for table in by_distance)
            parts[f"within_{edge:g}m"] = near
        return parts

    def _mean(self, *tables: Tensor, **options: bool) -> Float[Tensor, "*n"]:
        return self._occupied(F.iou_compute(*tables, **options))

    def _occupied(self, of_classes: Float[Tensor, "*n c"]) -> Float[Tensor, "*n"]:
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
