"""KAR-mIoU under other parameters, all from one pass."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import pandas as pd
import torch
from jaxtyping import Bool, Float, Int, Int64, UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .tables import Scores, TableMetric, Tables

PARAMETERS = ("min_speed_mps", "horizon_s", "decay_per_s", "penalty_scale")
GRID = {
    "min_speed_mps": (2.5, 5.0, 10.0),
    "horizon_s": (2.5, 5.0, 10.0),
    "decay_per_s": (0.25, 0.5, 1.0),
    "penalty_scale": (1.0, 2.0, 4.0),
}


class KARSensitivity(TableMetric):
    """KAR-mIoU for every combination of some values of its parameters.

    Of every frame it keeps how many errors of each class lie at each distance; any penalty is a
    sum over those. `compute` gives ``kar_miou [<v_min>, <T_h>, <lambda>, <gamma>]`` for each
    combination, in the order of `settings`.

    Args:
        values: the values of each parameter, by the names of `KARMeanIoU`'s arguments; those left
            out have the paper's value.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> kar = KARSensitivity(grid, {"penalty_scale": (0.0, 2.0)})
    >>> target = torch.tensor([0, 0, 8, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 8, 8, 8]).view(1, 4, 1, 1)
    >>> kar.update(preds, target, torch.tensor([10.0]))
    >>> [round(float(score), 3) for score in kar.compute().values()]
    [0.5, 0.269]
    """

    hits: Tensor
    errors: Tensor
    excess: Tensor
    shell: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        values: Mapping[str, Sequence[float]] = GRID,
        num_classes: int = 9,
        free_index: int = 8,
        ignore_index: int = 255,
        **kwargs: Any,
    ) -> None:
        if unknown := sorted(set(values) - set(PARAMETERS)):
            raise UserError(f"{unknown[0]}: is none of {', '.join(PARAMETERS)}")
        if empty := [name for name, of_name in values.items() if not len(of_name)]:
            raise UserError(f"{empty[0]}: has no value; give one or more")
        if twice := [name for name, of_name in values.items() if len({*of_name}) < len(of_name)]:
            raise UserError(f"{twice[0]}: {list(values[twice[0]])} names a value twice")
        F.check_classes(num_classes, ignore_index, free_index)
        chosen = [values.get(name, (getattr(F.Penalty(), name),)) for name in PARAMETERS]
        self.penalties = [F.Penalty(**dict(zip(PARAMETERS, row))) for row in product(*chosen)]
        shapes = {"hits": (num_classes,), "errors": (num_classes,)}
        super().__init__({**shapes, "excess": (len(self.penalties), num_classes)}, **kwargs)
        self.grid, self.num_classes = grid, num_classes
        self.free_index, self.ignore_index = free_index, ignore_index
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)

    @property
    def settings(self) -> pd.DataFrame:
        """The parameters of every combination."""
        return pd.DataFrame([vars(penalty) for penalty in self.penalties])[list(PARAMETERS)]

    def frame_tables(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Tables:
        """``hits`` and ``errors`` (false positives and negatives) of every class, and the
        ``excess`` penalty of these errors [setting, class], of every frame."""
        F.check_shapes(preds, target, {"mask": mask}, self.grid.shape, self.num_classes)
        speeds_mps = F.speeds(velocity, batch=len(target))
        ids = (self.num_classes, self.ignore_index)
        codes = F.encode(F.labels_of(preds), target, mask, *ids).flatten(1)
        frames = [self._frame(frame, speed) for frame, speed in zip(codes, speeds_mps)]
        empty = [table.new_zeros(0, *table.shape) for table in self.tables.values()]
        stacked = [torch.stack(rows) for rows in zip(*frames)] or empty
        return dict(zip(self.shapes, stacked))

    def scores(self, tables: Tables) -> Scores:
        """The scores of tables as `frame_tables` gives them, summed."""
        hits, errors = (tables[name].double()[..., None, :] for name in ("hits", "errors"))
        penalized = errors + tables["excess"].double() / F.FIXED_POINT
        kar = F.mean_iou(hits / (hits + penalized), without=self.free_index)
        return {
            f"kar_miou {[*map(float, row)]}": kar[..., n]
            for n, row in enumerate(self.settings.itertuples(index=False))
        }

    def _frame(
        self, codes: UInt8[Tensor, "v"], speed_mps: float
    ) -> tuple[Int64[Tensor, "c"], Int64[Tensor, "c"], Int64[Tensor, "p c"]]:
        count = torch.bincount(codes, minlength=256).view(16, 16)
        count = count[: self.num_classes, : self.num_classes]
        hits = count.diagonal()
        wrong = torch.nonzero((codes ^ (codes >> 4)) & 15).squeeze(1)
        shells, at = len(self.shell_m), self.shell.index_select(0, wrong)
        classes = torch.cat([codes[wrong] >> 4, codes[wrong] & 15])
        cells = classes.long() * shells + at.repeat(2)
        errors = torch.bincount(cells, minlength=self.num_classes * shells)
        errors = errors.view(self.num_classes, shells)
        # Whole numbers below 2**53: any order of summation is exact.
        excess = errors.double() @ self._excess(speed_mps).T.to(codes.device)
        return hits, errors.sum(1), excess.long().T

    def _excess(self, speed_mps: float) -> Float[Tensor, "p s"]:
        rows = [p.excess_table(self.shell_m, [speed_mps])[0] for p in self.penalties]
        return torch.stack(rows).double()
