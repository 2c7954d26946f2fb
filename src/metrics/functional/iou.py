"""Scores as pure functions of [target, prediction] tables; leading dimensions are kept."""

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from .penalty import FIXED_POINT


def iou_compute(
    count: Int64[Tensor, "*n c c"],
    excess: Int64[Tensor, "*n c c"] | None = None,
    false_positives: bool = True,
    false_negatives: bool = True,
) -> Float[Tensor, "*n c"]:
    """IoU of every class; with the table of excess penalties, its KAR-IoU (App. A.4).

    ::

        KAR-IoU_c = TP_c / (TP_c + sum of p_i over FP_c + sum of p_i over FN_c),   p_i = 1 for IoU

    Without ``false_positives`` or ``false_negatives`` that kind of error weighs 1 as in the IoU. A
    class with no TP, FP or FN is NaN. float64.
    """
    hits = count.diagonal(dim1=-2, dim2=-1)
    errors = (count.sum(-2) + count.sum(-1) - 2 * hits).double()
    if excess is not None:
        kinds = ((-2, false_positives), (-1, false_negatives))
        errors = errors + sum(
            excess.sum(dim).double() / FIXED_POINT for dim, penalized in kinds if penalized
        )
    return hits.double() / (hits.double() + errors)


def precision_compute(
    count: Int64[Tensor, "*n c c"], excess: Int64[Tensor, "*n c c"] | None = None
) -> Float[Tensor, "*n c"]:
    """TP / (TP + sum of p_i over FP) of every class; NaN where it was never predicted. float64."""
    return _share(count, excess, -2)


def recall_compute(
    count: Int64[Tensor, "*n c c"], excess: Int64[Tensor, "*n c c"] | None = None
) -> Float[Tensor, "*n c"]:
    """TP / (TP + sum of p_i over FN) of every class; NaN where it never was. float64."""
    return _share(count, excess, -1)


def _share(
    count: Int64[Tensor, "*n c c"], excess: Int64[Tensor, "*n c c"] | None, dim: int
) -> Float[Tensor, "*n c"]:
    hits = count.diagonal(dim1=-2, dim2=-1).double()
    whole = count.sum(dim).double()
    if excess is not None:
        whole = whole + excess.sum(dim).double() / FIXED_POINT
    return hits / whole


def mean_iou(iou: Float[Tensor, "*n c"], without: int | None = None) -> Float[Tensor, "*n"]:
    """Mean over the classes that are not NaN, without one of them if asked; NaN if none is left."""
    kept = [class_id for class_id in range(iou.shape[-1]) if class_id != without]
    return iou[..., kept].nanmean(dim=-1)


def geometric_iou(count: Int64[Tensor, "*n c c"], free_index: int) -> Float[Tensor, "*n"]:
    """IoU of what is occupied, whatever its class; NaN where nothing is, nor was predicted."""
    occupied = torch.arange(count.shape[-1], device=count.device) != free_index
    hits = _sum(count, occupied, occupied)
    errors = _sum(count, occupied, ~occupied) + _sum(count, ~occupied, occupied)
    return hits / (hits + errors)


def _sum(
    count: Int64[Tensor, "*n c c"], rows: Bool[Tensor, "c"], columns: Bool[Tensor, "c"]
) -> Float[Tensor, "*n"]:
    return count[..., rows, :][..., columns].sum((-2, -1)).double()
