"""The paper's occupancy loss (Eq. 10): a sum of named, weighted terms.

The paper has two, safety-weighted cross-entropy and Lovász-Softmax. A term is a function of the
scores [C, V] and the labels [V] of the V supervised voxels, and of its own settings, that gives one
number; ``loss.terms`` in the configuration names it. `docs/extending.md` adds one.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ..errors import UserError, closest
from ..ontology import CAR, CLASSES, LARGE_VEHICLE, NUM_CLASSES, THIN_STRUCTURE, UNKNOWN, VRU
from .tensors import Labels, Logits, Scalar, VoxelLabels, VoxelScores

# What a UAV must not hit and what must not be hit (App. A.5).
SAFETY_CRITICAL = (THIN_STRUCTURE, LARGE_VEHICLE, CAR, VRU)
CLASS_WEIGHTS = "class_weights"
# The float32 1.0, read as an int32.
FLOAT_ONE_BITS = 0x3F800000


class OccupancyLoss(nn.Module):
    """Eq. 10: the weighted sum of named terms over the supervised voxels.

    ``terms`` maps a name to a `functools.partial` of the term's function. Its keyword ``weight`` is
    the factor in the sum, 1 where none is given; its other keywords are the function's settings. A
    setting that is itself a partial is called with ``class_counts`` [9], the voxels of each class
    in the training labels; one that is a list of numbers becomes a tensor. A term of weight 0 is
    neither computed nor returned.

    Raises `UserError` that names the key, such as ``loss.terms.lovasz.weight``, for a weight that
    is no finite number of 0 or more, for a setting that the function does not take, for class
    weights that are not one a class, and where no term is left.
    """

    def __init__(
        self,
        terms: Mapping[str, Callable[..., Tensor]],
        class_counts: Sequence[float] | None = None,
    ) -> None:
        super().__init__()
        built = [Term(name, function, class_counts) for name, function in terms.items()]
        self.terms = nn.ModuleList(term for term in built if term.weight)
        if not self.terms:
            raise UserError("loss.terms: no term has a weight above 0; give one at least")

    @property
    def class_weights(self) -> Float[Tensor, "c"] | None:
        """The class weights of the first term that has any."""
        return next((t.class_weights for t in self.terms if hasattr(t, "class_weights")), None)

    def forward(self, logits: Logits, target: Labels) -> dict[str, Scalar]:
        """Returns the value of every term by its name, and their weighted sum as ``total``."""
        # Gathered once, for all terms.
        scores, labels = supervised(logits, target)
        values = {term.name: term(scores, labels) for term in self.terms}

        total = sum(term.weight * values[term.name] for term in self.terms)
        return {**values, "total": total}


class Term(nn.Module):
    """One term of the loss: a function with its settings, under a name and with a weight."""

    def __init__(
        self, name: str, function: Callable[..., Tensor], class_counts: Sequence[float] | None
    ) -> None:
        super().__init__()
        self.name, key = name, f"loss.terms.{name}"
        if name == "total" or not callable(function):
            raise UserError(f"{key}: is no term; give another name, a _target_ and _partial_: true")

        # A function that is no partial has no settings.
        self.function = getattr(function, "func", function)
        settings = dict(getattr(function, "keywords", {}))
        weight = settings.pop("weight", 1.0)
        if type(weight) not in (int, float) or not 0 <= weight < math.inf:
            raise UserError(
                f"{key}.weight: {weight!r} is no weight; give a finite number, 0 or more"
            )
        self.weight = float(weight)
        _require_taken(key, self.function, settings)

        self.settings = {}
        for setting, value in settings.items():
            if isinstance(value, partial):
                value = _of_counts(f"{key}.{setting}", value, class_counts)
            if isinstance(value, list | tuple):
                value = _numbers(f"{key}.{setting}", value)
            if setting == CLASS_WEIGHTS and value is not None:
                _require_one_a_class(f"{key}.{setting}", value)
            if isinstance(value, Tensor):
                # Not in checkpoints: they hold the class counts, from which it is computed again.
                self.register_buffer(setting, value, persistent=False)
            else:
                self.settings[setting] = value

    def forward(self, scores: VoxelScores, labels: VoxelLabels) -> Scalar:
        """Returns the term's value. Raises `UserError` for a function that gives no single one."""
        value = self.function(scores, labels, **self.settings, **dict(self.named_buffers()))
        if value.ndim:
            raise UserError(
                f"loss.terms.{self.name}: gives {list(value.shape)} numbers; reduce them to one"
            )
        return value


def _require_taken(key: str, function: Callable, settings: Mapping[str, Any]) -> None:
    """Raises `UserError` for a setting that the function of a term does not take."""
    parameters = list(inspect.signature(function).parameters.values())[2:]
    taken = [each.name for each in parameters]
    for name in settings:
        if name not in taken and all(each.kind is not each.VAR_KEYWORD for each in parameters):
            raise UserError(
                f"{key}.{name}: {function.__name__} takes no such setting"
                f"{closest(name, taken)} there are {', '.join(['weight', *taken])}"
            )


def _numbers(key: str, values: Sequence) -> Float[Tensor, "n"]:
    if any(type(value) not in (int, float) for value in values):
        raise UserError(f"{key}: {list(values)} are no numbers")
    return torch.tensor(values, dtype=torch.float32)


def _require_one_a_class(key: str, weights: Float[Tensor, "n"]) -> None:
    sound = weights.isfinite().all() and (weights >= 0).all() and weights.sum() > 0
    if len(weights) != NUM_CLASSES or not sound:
        raise UserError(
            f"{key}: {weights.tolist()} are {len(weights)}; give {NUM_CLASSES} numbers of 0 or "
            f"more, one of them above, for {', '.join(CLASSES)}"
        )


def _of_counts(key: str, rule: Callable, class_counts: Sequence[float] | None) -> Any:
    """Computes a setting from the class counts of the training set."""
    if class_counts is None:
        raise UserError(f"{key}: is computed from the training set's class counts; give them")
    try:
        return rule(class_counts)
    except UserError as error:
        raise UserError(f"{key}: {error}") from None


def supervised(logits: Logits, target: Labels) -> tuple[VoxelScores, VoxelLabels]:
    """Returns logits and labels (int64) of the voxels that are not unknown, over the whole batch.

    They are pooled: a term is not a mean over frames.
    """
    target = target.flatten()
    voxels = (target != UNKNOWN).nonzero()[:, 0]

    by_class = logits.float().transpose(0, 1).flatten(1)
    # Plain indexing would have a slower backward.
    return by_class.index_select(1, voxels), target[voxels].long()


def cross_entropy(
    scores: VoxelScores, labels: VoxelLabels, class_weights: Float[Tensor, "c"] | None = None
) -> Scalar:
    """First term of Eq. 10: ``1/|Omega| sum_i class_weights[y_i] CE_i`` over the voxels Omega.

    ``None`` weighs every class with 1. Without a voxel the loss is 0, with a graph.
    """
    # Divided by the number of voxels: PyTorch's own mean divides by the sum of their weights.
    total = F.cross_entropy(scores[None], labels[None], class_weights, reduction="sum")
    return total / max(len(labels), 1)


def lovasz(scores: VoxelScores, labels: VoxelLabels) -> Scalar:
    """Second term of Eq. 10: exact Lovász-Softmax (Berman et al. 2018).

    The mean over the classes that are present, free space included. Without a voxel the loss is 0,
    with a graph.
    """
    return _LovaszExtension.apply(scores.softmax(dim=0), labels)


class _LovaszExtension(torch.autograd.Function):
    """Mean over the classes present of ``errors @ slopes``, from probabilities [C, V].

    The slopes are its derivative too, so the backward is one multiplication, with no graph through
    the sorting.
    """

    @staticmethod
    def forward(ctx, probability: VoxelScores, labels: VoxelLabels):
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
    def backward(ctx, grad: Scalar):
        (gradient,) = ctx.saved_tensors
        return grad * gradient, None


def _lovasz_slope(
    error: Float[Tensor, "v"], is_class: Bool[Tensor, "v"], out: Float[Tensor, "v"]
) -> Float[Tensor, "v"]:
    """Derivative of the Lovász extension of the Jaccard loss to each probability, in [-1, 1].

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
    the mean over the training voxels is 1, which leaves the balance with the Lovász term as it was.
    A class that training lacks gets the cap. Raises `UserError` for counts that are all zero, and
    for a cap or a factor that makes no weight.
    """
    if not (max_ratio >= 1 and safety_factor > 0):
        raise UserError(
            f"class_weights: max_ratio={max_ratio} and safety_factor={safety_factor}; give 1 or "
            "more, and a number above 0"
        )
    counts = torch.as_tensor(counts, dtype=torch.float64)
    if len(counts) != NUM_CLASSES or counts.min() < 0 or counts.sum() == 0:
        raise UserError(
            f"voxel counts {counts.tolist()} are not {NUM_CLASSES} numbers, some of them positive; "
            "is the training set empty?"
        )

    weight = (counts.max() / counts).sqrt().clamp(max=max_ratio)
    weight[list(SAFETY_CRITICAL)] *= safety_factor
    return (weight / ((counts / counts.sum()) @ weight)).float()
