"""KAR-mIoU under other parameters, all from one pass."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import pandas as pd
import torch
from jaxtyping import UInt8
from torch import Tensor

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import functional as F
from src.metrics.count_metric import NamedCounts, Scores, VoxelMetric

PARAMETERS = ("min_speed_mps", "horizon_s", "decay_per_s", "penalty_scale")

# Half, once and twice the paper's value of each parameter.
GRID = {
    name: [factor * getattr(F.Penalty(), name) for factor in (0.5, 1, 2)] for name in PARAMETERS
}


class KARSensitivity(VoxelMetric):
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

    in_score_table = False
    hits: Tensor
    errors: Tensor
    excess: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        values: Mapping[str, Sequence[float]] = GRID,
        *arguments: Any,
        **kwargs: Any,
    ) -> None:
        for name, chosen in values.items():
            if name not in PARAMETERS:
                raise UserError(f"{name}: is none of {', '.join(PARAMETERS)}")
            if not len(chosen):
                raise UserError(f"{name}: has no value; give one or more")
            if len(set(chosen)) < len(chosen):
                raise UserError(f"{name}: {list(chosen)} names a value twice")

        every = [values.get(name, (getattr(F.Penalty(), name),)) for name in PARAMETERS]
        self.penalties = [F.Penalty(**dict(zip(PARAMETERS, row))) for row in product(*every)]
        super().__init__(grid, *arguments, **kwargs)
        of_classes = (self.num_classes,)
        self.add_counts(
            hits=of_classes, errors=of_classes, excess=(len(self.penalties), *of_classes)
        )

    @property
    def settings(self) -> pd.DataFrame:
        """The parameters of every combination."""
        return pd.DataFrame([vars(penalty) for penalty in self.penalties])[list(PARAMETERS)]

    def frame_counts(
        self, preds: F.Preds, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> NamedCounts:
        """Returns ``hits`` and ``errors`` (false positives and negatives) of every class, and the
        ``excess`` penalty of these errors [setting, class], of every frame."""
        codes = self.codes(preds, target, mask).flatten(1)
        speeds_mps = F.speeds(velocity, batch=len(target))
        return self.stacked([self._frame(*frame) for frame in zip(codes, speeds_mps)])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        hits, errors = (counts[name].double()[..., None, :] for name in ("hits", "errors"))
        penalized = errors + counts["excess"].double() / F.FIXED_POINT
        kar = F.mean_iou(hits / (hits + penalized), without=self.free_index)
        return {
            f"kar_miou {[*map(float, row)]}": kar[..., n]
            for n, row in enumerate(self.settings.itertuples(index=False))
        }

    def _frame(self, codes: UInt8[Tensor, "v"], speed_mps: float) -> NamedCounts:
        count = torch.bincount(codes, minlength=256).view(16, 16)
        hits = count.diagonal()[: self.num_classes]

        # How many errors of each class lie at each distance. An error is one of two classes: a
        # false negative of the true one, a false positive of the predicted one.
        wrong = torch.nonzero((codes ^ (codes >> 4)) & 15).squeeze(1)
        classes = torch.cat([codes[wrong] >> 4, codes[wrong] & 15])
        shells = len(self.shell_m)
        cells = classes.long() * shells + self.shell.index_select(0, wrong).repeat(2)
        errors = torch.bincount(cells, minlength=self.num_classes * shells)
        errors = errors.view(self.num_classes, shells)

        # Whole numbers below 2**53: any order of summation is exact.
        weights = [each.excess_table(self.shell_m, speed_mps) for each in self.penalties]
        excess = errors.double() @ torch.stack(weights).double().T.to(codes.device)
        return {"hits": hits, "errors": errors.sum(1), "excess": excess.long().T}
