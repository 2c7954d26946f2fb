"""The voxel prior: the strongest prediction that never looks at the image."""

import math
from collections.abc import Callable, Iterable, Sequence

import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from ..ontology import UNKNOWN

# Weights of free from 1 down to 0.001. None lies above 1: the decision that maximises an IoU of J
# calls a voxel occupied where its odds exceed J, and J is at most 1.
CANDIDATES = tuple(10 ** (-step / 4) for step in range(13))


class VoxelPrior:
    """Predicts for each voxel of the occ frame its most frequent training label.

    It is an anchor: a model that does not beat it has learnt where things usually are, and not what
    is there now. Free space is the most frequent label nearly everywhere, so its count is first
    multiplied by ``free_weight``, which `fit` chooses on validation; 1 is the plain majority.
    """

    def __init__(
        self, shape: tuple[int, int, int], num_classes: int = 9, free_index: int = 8
    ) -> None:
        self.shape = tuple(shape)
        self.num_classes = num_classes
        self.free_index = free_index
        self.free_weight = 1.0
        # The last row takes the unknown labels.
        self._counts = torch.zeros(num_classes + 1, *self.shape, dtype=torch.int32)

    @property
    def counts(self) -> Int[Tensor, "c X Y Z"]:
        """Returns how often each class was the label of each voxel."""
        return self._counts[:-1]

    def count(self, semantics: UInt8[Tensor, "*batch X Y Z"]) -> None:
        """Counts the labels of training frames.

        Unknown voxels (255) are not counted. Raises `UserError` for another dtype or shape, or a
        class id out of range.
        """
        if semantics.dtype != torch.uint8 or tuple(semantics.shape[-3:]) != self.shape:
            raise UserError(
                f"semantics: {semantics.dtype} {list(semantics.shape)} is not uint8 and does not "
                f"end in the prior's shape {list(self.shape)}"
            )

        labels = semantics.cpu().reshape(-1, *self.shape)
        present = set(labels.flatten().bincount().nonzero().flatten().tolist())
        if wrong := present - {UNKNOWN, *range(self.num_classes)}:
            raise UserError(
                f"semantics: class ids {sorted(wrong)} are neither 0 to {self.num_classes - 1} "
                f"nor {UNKNOWN}"
            )

        one = torch.ones(1, 1, 1, 1, dtype=torch.int32).expand(1, *self.shape)
        for frame in labels:
            self._counts.scatter_add_(0, frame.clamp(max=self.num_classes).long()[None], one)

    def labels(self, free_weight: float | None = None) -> UInt8[Tensor, "X Y Z"]:
        """Returns the prediction under a weight of free space, by default the one `fit` chose.

        A tie between free and occupied is occupied, one between occupied classes the lower id. A
        voxel that no training frame labelled is free.
        """
        weight = self.free_weight if free_weight is None else free_weight
        counts = self.counts.clone()
        counts[self.free_index] = -1
        occupied_count, occupied = counts.max(dim=0)

        wins = occupied_count >= weight * self.counts[self.free_index].double()
        wins &= occupied_count > 0
        return torch.where(wins, occupied.to(torch.uint8), self.free_index)

    def fit(
        self,
        frames: Iterable[tuple[Int[Tensor, "*batch X Y Z"], Float[Tensor, "*batch 3"]]],
        make_scores: Callable[[], Metric],
        candidates: Sequence[float] = CANDIDATES,
    ) -> dict[float, float]:
        """Chooses ``free_weight`` on validation ``frames``, pairs of target and velocity in m/s.

        The criterion is the one that selects checkpoints: the highest ``kar_miou`` of the
        `OccupancyScores` that ``make_scores`` makes, and the larger weight where two are equal.
        Returns every candidate's score. The frames are read once, and candidates that predict the
        same are scored once. Raises `UserError` when the frames leave the score undefined.
        """
        # Voxels only turn from free to occupied as the weight falls: equal predictions are
        # neighbours, and the weights keep their falling order.
        alike: dict[bytes, list[float]] = {}
        for weight in sorted(candidates, reverse=True):
            alike.setdefault(self.labels(weight).numpy().tobytes(), []).append(weight)

        scored = [(self.labels(weights[0]), make_scores()) for weights in alike.values()]
        for target, velocity in frames:
            target = target.reshape(-1, *self.shape)
            for labels, metric in scored:
                preds = labels.to(target.device).expand_as(target)
                metric.update(preds, target, velocity.reshape(-1, 3))

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
