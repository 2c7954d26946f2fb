"""KAR-mIoU, the paper's safety-aware score (Sec. 3.3, App. A.4), and the IoU of every class."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import OURS, NamedCounts, Scores, VoxelMetric


class ConfusionMetric(VoxelMetric):
    """Two counts [target, prediction] over a dataset: voxels, and their excess penalties.

    The arguments are those of `KARMeanIoU`; a subclass adds `scores`. One that keeps parts of space
    apart gives the shape of their numbers as ``parts`` and overrides `part_of`: then the counts are
    [*parts, c, c].
    """

    count: Tensor
    excess: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        free_index: int = OURS,
        ignore_index: int | None = 255,
        horizon_s: float = 5.0,
        decay_per_s: float = 0.5,
        penalty_scale: float = 2.0,
        min_speed_mps: float = 5.0,
        backend: str = "auto",
        *,
        parts: tuple[int, ...] = (),
        **kwargs: Any,
    ) -> None:
        super().__init__(grid, num_classes, free_index, ignore_index, **kwargs)

        F.is_compiled(backend, torch.device("cpu"))  # raises for a backend that there is not
        self.backend = backend
        self.penalty = F.Penalty(horizon_s, decay_per_s, penalty_scale, min_speed_mps)
        self.parts = parts
        self.add_counts(**dict.fromkeys(("count", "excess"), (*parts, num_classes, num_classes)))

    def frame_counts(
        self,
        preds: F.Preds,
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None = None,
        visible: F.Mask | None = None,
    ) -> NamedCounts:
        """Returns ``count`` and ``excess`` of every frame.

        ``preds`` are class ids of any integer dtype or float logits, ``velocity`` the UAV's
        velocity or speed in m/s, ``mask`` restricts what is counted, and ``visible`` is read by
        metrics that keep visible voxels apart; without it none is visible. Raises `UserError` for
        shapes that fit neither each other nor the grid, class ids out of range at counted voxels,
        and NaN in logits or velocities. A batch without a counted voxel is no error.
        """
        codes = self.codes(preds, target, mask, visible=visible)
        speeds_mps = F.speeds(velocity, batch=len(target))
        if visible is None:
            visible = torch.zeros_like(codes, dtype=torch.bool)
        return self.confusion(codes, speeds_mps, visible)

    def confusion(
        self,
        codes: UInt8[Tensor, "b X Y Z"],
        speeds_mps: Sequence[float],
        visible: Bool[Tensor, "b X Y Z"],
    ) -> NamedCounts:
        """Returns ``count`` and ``excess`` of every frame, from its codes (`functional.encode`)."""
        counts = F.confusion_counts(
            codes,
            self.shell,
            [self.penalty.excess_table(self.shell_m, v).to(codes.device) for v in speeds_mps],
            [self.part_of(*frame) for frame in zip(speeds_mps, visible.flatten(1))],
            math.prod(self.parts),
            self.num_classes,
            self.backend,
        )

        shape = (len(codes), *self.count.shape)
        return {name: each.reshape(shape) for name, each in zip(("count", "excess"), counts)}

    def part_of(self, speed_mps: float, visible: Bool[Tensor, "v"]) -> Int[Tensor, "v"] | None:
        """Returns the part of space of every voxel, numbered row by row.

        ``None`` stands for all of it in one part.
        """
        return None


class KARMeanIoU(ConfusionMetric):
    """Mean KAR-IoU of the occupied classes: IoU in which near errors weigh more.

    `functional.kar_mean_iou` is its definition, with the paper's equations. The score is the mean
    over the classes other than ``free_index``, in [0, 1]. Correct voxels are never rewarded for
    being near. A class with no TP, FP or FN in the dataset is left out of the mean; when none is
    left, the score is NaN. Unknown voxels are never counted.

    Args:
        grid: the voxels that the tensors cover, in metres in the occ frame.
        num_classes: class ids run from 0 to ``num_classes - 1``; 15 at most, as label and
            prediction of a voxel share one byte.
        free_index: the class of free space, whose own KAR-IoU `OccupancyScores` reports; 8, and to
            be given where there are not nine classes.
        ignore_index: the target label of unknown voxels; ``None``: every label counts.
        horizon_s: the time to collision beyond which an error weighs 1 (the paper's T_h).
        decay_per_s: how fast the penalty falls with that time (lambda).
        penalty_scale: the most that is added to an error's weight (gamma).
        min_speed_mps: a slower UAV is taken to fly at this speed (v_min).
        backend: how voxels are counted: ``numba`` (one compiled pass, CPU only), ``torch`` (plain
            operations, any device), or ``auto``, the faster one that runs there. All give the same
            bits.

    Raises `UserError`, a ``ValueError``, for parameters or batches that make no sense; see
    `update` for the shapes.

    >>> import torch
    >>> from src.geometry import VoxelGrid
    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([0, 0, 5, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 0, 8, 8]).view(1, 4, 1, 1)    # the car 5 m ahead is missed
    >>> score = KARMeanIoU(grid)
    >>> score.update(preds, target, velocity=torch.tensor([[10.0, 0.0, 0.0]]))
    >>> score.compute()                                        # the building 1, the car 0
    tensor(0.5000)
    """

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns ``kar_miou`` of ``count`` and ``excess`` [*n, c, c]."""
        kar_iou = F.iou_compute(counts["count"], counts["excess"])
        return {"kar_miou": F.mean_iou(kar_iou, without=self.free_index)}

    def compute(self) -> Float[Tensor, ""]:
        """Returns the score of everything counted so far."""
        return super().compute()["kar_miou"]


class OccupancyScores(ConfusionMetric):
    """IoU and KAR-IoU of every class, and their means, from one pass; arguments as `KARMeanIoU`.

    `compute` gives a dict of scalars in [0, 1]:

    - ``miou``: mean IoU over all classes, free space included (the paper's mIoU),
    - ``miou_occupied``: mean IoU without free space, which is ``kar_miou`` at ``penalty_scale=0``,
    - ``kar_miou``: mean KAR-IoU without free space (the paper's KAR-mIoU),
    - ``iou/<class>`` and ``kar_iou/<class>``: per class, free space included. The names are those
      of the ontology, or the class ids when ``num_classes`` is another.

    A class with no TP, FP or FN is NaN and left out of the means.

    >>> import torch
    >>> from src.geometry import VoxelGrid
    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([0, 0, 8, 255]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 8, 8, 0]).view(1, 4, 1, 1)    # the building 3 m ahead is missed
    >>> scores = OccupancyScores(grid)
    >>> scores.update(preds, target, velocity=torch.tensor([10.0]))
    >>> for name, value in scores.compute().items():
    ...     if not value.isnan():
    ...         print(f"{name:16} {value:.3f}")
    miou             0.500
    miou_occupied    0.500
    kar_miou         0.269
    iou/building     0.500
    iou/free         0.500
    kar_iou/building 0.269
    kar_iou/free     0.269
    """

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of ``count`` and ``excess`` [*n, c, c]."""
        iou = F.iou_compute(counts["count"])
        kar_iou = F.iou_compute(counts["count"], counts["excess"])
        return {
            "miou": F.mean_iou(iou),
            "miou_occupied": F.mean_iou(iou, without=self.free_index),
            "kar_miou": F.mean_iou(kar_iou, without=self.free_index),
            **self.of_classes("iou", iou),
            **self.of_classes("kar_iou", kar_iou),
        }
