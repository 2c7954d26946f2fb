"""Scores as pure functions of [target, prediction] counts; leading dimensions are kept."""

from jaxtyping import Float, Float64, Int64
from torch import Tensor

from .penalty import FIXED_POINT

# A sum of frames; that of resampled clips is weighted, and float64.
Confusion = Int64[Tensor, "*n c c"] | Float64[Tensor, "*n c c"]


def iou_compute(
    count: Confusion,
    excess: Confusion | None = None,
    false_positives: bool = True,
    false_negatives: bool = True,
) -> Float[Tensor, "*n c"]:
    """Returns the IoU of every class; with the counts of excess penalties, its KAR-IoU.

    ::

        KAR-IoU_c = TP_c / (TP_c + sum of p_i over FP_c + sum of p_i over FN_c),   p_i = 1 for IoU

    Without ``false_positives`` or ``false_negatives`` that kind of error weighs 1 as in the IoU. A
    class with no TP, FP or FN is NaN. float64.
    """
    hits = count.diagonal(dim1=-2, dim2=-1)
    errors = (count.sum(-2) + count.sum(-1) - 2 * hits).double()

    if excess is not None:
        # Column c holds the false positives of class c, row c its false negatives.
        kinds = ((-2, false_positives), (-1, false_negatives))
        errors = errors + sum(
            excess.sum(dim).double() / FIXED_POINT for dim, penalized in kinds if penalized
        )
    return hits.double() / (hits.double() + errors)


def precision_compute(count: Confusion, excess: Confusion) -> Float[Tensor, "*n c"]:
    """Returns TP / (TP + sum of p_i over FP) of every class; NaN where it was never predicted."""
    hits = count.diagonal(dim1=-2, dim2=-1).double()
    return hits / (count.sum(-2).double() + excess.sum(-2).double() / FIXED_POINT)


def recall_compute(count: Confusion, excess: Confusion) -> Float[Tensor, "*n c"]:
    """Returns TP / (TP + sum of p_i over FN) of every class; NaN where it never was."""
    # Transposed counts have the false negatives of a class where the false positives were.
    return precision_compute(count.mT, excess.mT)


def mean_iou(iou: Float[Tensor, "*n c"], without: int | None = None) -> Float[Tensor, "*n"]:
    """Returns the mean over the classes that are not NaN, ``without`` one of them if asked; NaN if
    none is left."""
    kept = [class_id for class_id in range(iou.shape[-1]) if class_id != without]
    return iou[..., kept].nanmean(dim=-1)


def geometric_iou(count: Confusion, free_index: int) -> Float[Tensor, "*n"]:
    """Returns the IoU of occupied against free, whatever the class; NaN if no voxel is occupied in
    prediction or truth."""
    free = count[..., free_index, free_index]
    union = count.sum((-2, -1)) - free
    missed = count[..., :, free_index].sum(-1) - free
    phantom = count[..., free_index, :].sum(-1) - free
    return (union - missed - phantom).double() / union.double()
