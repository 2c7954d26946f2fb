"""Priors of the voxels: what can be predicted without a look at the image."""

import math
from collections.abc import Callable, Iterable

import torch
from jaxtyping import Float, Int, Shaped, UInt8
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from ..ontology import FREE, NUM_CLASSES, UNKNOWN

# Weights of free from 1 down to 0.001. None lies above 1: the decision that maximises an IoU of J
# calls a voxel occupied where its odds exceed J, and J is at most 1.
CANDIDATES = tuple(10 ** (-step / 4) for step in range(13))
# Target, velocity in m/s, and the layer at which the target's lowest voxels lie.
LabelledFrame = tuple[UInt8[Tensor, "X Y Z"], Float[Tensor, "3"], int]


class VoxelPrior:
    """Predicts for each voxel its most frequent training label.

    It is a floor: a model that does not beat it has learnt where things usually are, and not what
    is there now. Free space is the most frequent label nearly everywhere, so its count is first
    multiplied by ``free_weight``, which `fit` chooses on validation; 1 is the plain majority.

    ``layers`` are the first and the last layer at which a frame's lowest voxels may lie. With one
    layer alone voxels are those of the occ frame, which moves with the UAV. With more they stand
    still while frames are counted higher or lower, by the UAV's height above the ground plane in
    voxels: so a model that is told its height has a floor that is told it, too.
    """

    def __init__(self, shape: tuple[int, int, int], layers: tuple[int, int] = (0, 0)) -> None:
        self.shape, self.layers = tuple(shape), layers
        self.free_weight = 1.0
        rows, columns, heights = self.shape
        # The last row takes the unknown labels.
        size = NUM_CLASSES + 1, rows, columns, heights + layers[1] - layers[0]
        self._counts = torch.zeros(size, dtype=torch.int32)

    @property
    def counts(self) -> Int[Tensor, "c X Y K"]:
        """The number of training frames in which each class was the label of each voxel."""
        return self._counts[:-1]

    def count(self, semantics: UInt8[Tensor, "X Y Z"], layer: int = 0) -> None:
        """Counts the labels of a training frame, whose lowest voxels lie at a layer.

        Unknown voxels (255) are not counted. Raises `UserError` for another dtype or shape, or a
        class id out of range.
        """
        if semantics.dtype != torch.uint8 or tuple(semantics.shape) != self.shape:
            raise UserError(
                f"semantics: {semantics.dtype} {list(semantics.shape)} is not uint8 "
                f"{list(self.shape)}, the prior's shape"
            )
        present = set(semantics.flatten().bincount().nonzero().flatten().tolist())
        if wrong := present - {UNKNOWN, *range(NUM_CLASSES)}:
            raise UserError(
                f"semantics: class ids {sorted(wrong)} are neither 0 to {NUM_CLASSES - 1} nor "
                f"{UNKNOWN}"
            )

        one = torch.ones(1, 1, 1, 1, dtype=torch.int32).expand(1, *self.shape)
        at_layer = self._seen(self._counts, layer)
        at_layer.scatter_add_(0, semantics.clamp(max=NUM_CLASSES).long()[None], one)

    def labels(self, free_weight: float | None = None) -> UInt8[Tensor, "X Y K"]:
        """Returns the prediction of every voxel under a weight of free space, by default the one
        that `fit` chose.

        A tie between free and occupied is occupied, one between occupied classes the lower id. A
        voxel that no training frame labelled is free.
        """
        weight = self.free_weight if free_weight is None else free_weight
        counts = self.counts.clone()
        counts[FREE] = -1
        occupied_count, occupied = counts.max(dim=0)

        wins = occupied_count >= weight * self.counts[FREE].double()
        wins &= occupied_count > 0
        return torch.where(wins, occupied.to(torch.uint8), FREE)

    def fit(
        self, frames: Iterable[LabelledFrame], make_scores: Callable[[], Metric]
    ) -> dict[float, float]:
        """Chooses ``free_weight``, one of `CANDIDATES`, on the ``frames`` of validation.

        The criterion is the one that selects checkpoints: the highest ``kar_miou`` of the
        `OccupancyScores` that ``make_scores`` makes, and the larger weight where two are equal.
        Returns every candidate's score. The frames are read once, and candidates that predict the
        same are scored once. Raises `UserError` when the frames leave the score undefined.
        """
        # Voxels only turn from free to occupied as the weight falls: equal predictions are
        # neighbours, and the weights keep their falling order.
        alike: dict[bytes, list[float]] = {}
        for weight in CANDIDATES:
            alike.setdefault(self.labels(weight).numpy().tobytes(), []).append(weight)

        scored = [(self.labels(weights[0]), make_scores()) for weights in alike.values()]
        for target, velocity, layer in frames:
            for labels, metric in scored:
                preds = self._seen(labels, layer)
                metric.update(preds[None], target[None], velocity[None])

        kar_miou = {}
        for weights, (_, metric) in zip(alike.values(), scored):
            kar_miou |= dict.fromkeys(weights, float(metric.compute()["kar_miou"]))
        if any(math.isnan(score) for score in kar_miou.values()):
            raise UserError(
                "voxel prior: the validation frames hold no occupied voxel to choose the weight "
                "of free space by; enlarge the validation split"
            )

        self.free_weight = max(kar_miou, key=kar_miou.__getitem__)
        return kar_miou

    def _seen(self, table: Tensor, layer: int) -> Tensor:
        return seen_from(table, layer - self.layers[0], self.shape[2])


def seen_from(
    table: Shaped[Tensor, "*c X Y K"], layer: int, heights: int
) -> Shaped[Tensor, "*c X Y heights"]:
    """Returns the part of a table of voxels that a grid covers whose lowest ones lie at a layer of
    it; beyond the first and the last layer, the part that is nearest."""
    start = min(max(layer, 0), table.shape[-1] - heights)
    return table[..., start : start + heights]
