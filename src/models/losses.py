"""The paper's occupancy loss (Eq. 10): safety-weighted cross-entropy and Lovasz-Softmax."""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor, nn

from ..errors import UserError
from ..ontology import CAR, LARGE_VEHICLE, NUM_CLASSES, THIN_STRUCTURE, UNKNOWN, VRU

SAFETY_CRITICAL = (THIN_STRUCTURE, LARGE_VEHICLE, CAR, VRU)
"""Thin structures, vehicles and VRUs (App. A.5)."""

FLOAT_ONE_BITS = 0x3F800000
"""The float32 1.0 read as an int32."""


def supervised(
    logits: Float[Tensor, "b c *space"], target: UInt8[Tensor, "b *space"], ignore_index: int
) -> tuple[Float[Tensor, "c v"], Int[Tensor, "v"]]:
    """Logits and labels (int64) of the voxels that count, over the whole batch."""
    target = target.flatten()
    voxels = (target != ignore_index).nonzero()[:, 0]
    by_class = logits.float().transpose(0, 1).flatten(1)
    return _Chosen.apply(by_class, voxels), target[voxels].long()


class _Chosen(torch.autograd.Function):
    """Columns of a matrix, each at most once; so the backward copies, where indexing would add."""

    @staticmethod
    def forward(ctx, matrix: Float[Tensor, "c n"], columns: Int[Tensor, "v"]):
        ctx.save_for_backward(columns)
        ctx.width = matrix.shape[1]
        return matrix.index_select(1, columns)

    @staticmethod
    def backward(ctx, grad: Float[Tensor, "c v"]):
        (columns,) = ctx.saved_tensors
        return grad.new_zeros(len(grad), ctx.width).index_copy_(1, columns, grad), None


def weighted_cross_entropy(
    logits: Float[Tensor, "b c *space"],
    target: UInt8[Tensor, "b *space"],
    weight: Float[Tensor, "c"] | None,
    ignore_index: int = UNKNOWN,
) -> Float[Tensor, ""]:
    """First term of Eq. 10: ``1/|Omega| sum_i weight[y_i] CE_i`` over the supervised voxels Omega.

    It divides by their number, not by the sum of their weights as PyTorch's mean does. No weight is
    weight 1; with nothing supervised it is 0, with a graph.
    """
    scores, labels = supervised(logits, target, ignore_index)
    return _cross_entropy(scores, labels, weight)


def lovasz_softmax(
    logits: Float[Tensor, "b c *space"],
    target: UInt8[Tensor, "b *space"],
    ignore_index: int = UNKNOWN,
) -> Float[Tensor, ""]:
    """Exact Lovasz-Softmax (Berman et al. 2018), mean over the classes present in the batch.

    Flattened over the batch, free space included; with nothing supervised it is 0, with a graph.
    """
    scores, labels = supervised(logits, target, ignore_index)
    return _lovasz(scores, labels)


def _cross_entropy(
    scores: Float[Tensor, "c v"], labels: Int[Tensor, "v"], weight: Float[Tensor, "c"] | None
) -> Float[Tensor, ""]:
    total = F.cross_entropy(scores[None], labels[None], weight, reduction="sum")
    return total / max(len(labels), 1)


def _lovasz(scores: Float[Tensor, "c v"], labels: Int[Tensor, "v"]) -> Float[Tensor, ""]:
    return _LovaszExtension.apply(scores.softmax(dim=0), labels)


class _LovaszExtension(torch.autograd.Function):
    """Mean over the classes present of ``errors @ slopes``, from probabilities [C, V].

    The slopes are its derivative too, so the backward is one multiplication, with no graph through
    the sorting.
    """

    @staticmethod
    def forward(ctx, probability: Float[Tensor, "c v"], labels: Int[Tensor, "v"]):
        counts = labels.bincount(minlength=len(probability)).tolist()
        share = 1 / max(sum(count > 0 for count in counts), 1)
        gradient = torch.empty_like(probability)
        total = probability.new_zeros(())
        for class_id, count in enumerate(counts):
            if count == 0:
                gradient[class_id] = 0
                continue
            is_class = labels == class_id
            error = torch.where(is_class, 1 - probability[class_id], probability[class_id])
            slope = _lovasz_slope(error, is_class, out=gradient[class_id]).mul_(share)
            # Each term is positive: an error grows as its slope says. A dot product rounds more.
            total += error.mul_(slope).abs_().sum()
        ctx.save_for_backward(gradient)
        return total

    @staticmethod
    def backward(ctx, grad: Float[Tensor, ""]):
        (gradient,) = ctx.saved_tensors
        return grad * gradient, None


def _lovasz_slope(
    error: Float[Tensor, "v"], is_class: Bool[Tensor, "v"], out: Float[Tensor, "v"]
) -> Float[Tensor, "v"]:
    """Derivative of the Lovasz extension of the Jaccard loss to each probability, in [-1, 1].

    To each error, it is the Jaccard loss's increase when the voxel joins those of larger error. In
    closed form: 1/U for a voxel of the class, I/(U (U-1)) for another one, with the intersection I
    and the union U after it joined; a difference of running Jaccard values would cancel. The error
    of a voxel of the class falls with its probability, so there the sign turns.
    """
    # Non-negative floats order as their bits do, and integers sort ten times faster; the lowest bit
    # carries the class along.
    falling = FLOAT_ONE_BITS - error.view(torch.int32)
    key, order = falling.mul_(2).add_(is_class).sort()
    sorted_is_class = key.bitwise_and_(1)
    joined = sorted_is_class.cumsum(0, dtype=torch.int32)
    intersection = joined[-1:] - joined
    rank = torch.arange(1, len(error) + 1, dtype=torch.int32, device=error.device)
    union = intersection + rank
    others = intersection / (union - 1).clamp_(min=1)
    slope = torch.where(sorted_is_class.bool(), -1, others).div_(union)
    return out.scatter_(0, order, slope)


def safety_weights(
    counts: Sequence[float] | Tensor, max_ratio: float = 4.0, safety_factor: float = 1.5
) -> Float[Tensor, "c"]:
    """The paper's alpha: class weights from the training set's voxel counts (App. A.5).

    The inverse square root of the class frequency, at most ``max_ratio`` times that of the most
    frequent class; times ``safety_factor`` for thin structures, vehicles and VRUs; scaled so that
    the mean over the training voxels is 1, which leaves the balance with the Lovasz term as it was.
    A class that training lacks gets the cap. Raises `UserError` for counts that are all zero.
    """
    counts = torch.as_tensor(counts, dtype=torch.float64)
    if len(counts) != NUM_CLASSES or counts.min() < 0 or counts.sum() == 0:
        raise UserError(
            f"loss.class_weights: voxel counts {counts.tolist()} are not {NUM_CLASSES} numbers, "
            "some of them positive; is the training set empty?"
        )
    weight = (counts.max() / counts).sqrt().clamp(max=max_ratio)
    weight[list(SAFETY_CRITICAL)] *= safety_factor
    return (weight / ((counts / counts.sum()) @ weight)).float()


class OccupancyLoss(nn.Module):
    """Eq. 10: weighted cross-entropy plus ``lovasz_weight`` (the paper's lambda) times Lovasz.

    ``class_weights`` [9] is the paper's alpha, ``None`` for uniform weights. Called with logits and
    labels, it gives ``{"cross_entropy", "lovasz", "total"}``; ``lovasz`` is left out, and not
    computed, at weight 0.
    """

    def __init__(
        self,
        class_weights: Float[Tensor, "c"] | None = None,
        lovasz_weight: float = 0.0,
        ignore_index: int = UNKNOWN,
    ) -> None:
        super().__init__()
        # Not in checkpoints: they are derived from the training set and the config.
        self.register_buffer("class_weights", class_weights, persistent=False)
        self.lovasz_weight, self.ignore_index = lovasz_weight, ignore_index

    def forward(
        self, logits: Float[Tensor, "b c *space"], target: UInt8[Tensor, "b *space"]
    ) -> dict[str, Float[Tensor, ""]]:
        scores, labels = supervised(logits, target, self.ignore_index)
        parts = {"cross_entropy": _cross_entropy(scores, labels, self.class_weights)}
        parts["total"] = parts["cross_entropy"]
        if self.lovasz_weight:
            parts["lovasz"] = _lovasz(scores, labels)
            parts["total"] = parts["total"] + self.lovasz_weight * parts["lovasz"]
        return parts
