"""What every score of voxels against voxels shares: the penalty, and two tables."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Bool, Int, UInt8
from torch import Tensor

from ..geometry import VoxelGrid
from . import functional as F
from .tables import Tables, VoxelMetric


class PenalizedConfusion(VoxelMetric):
    """Two [target, prediction] tables over a dataset: voxels, and their excess penalties.

    The arguments are those of `KARMeanIoU`; a subclass adds `scores`. One that keeps parts of space
    apart gives the shape of their numbers as ``parts`` and overrides `part_of`: then the tables are
    [*parts, c, c].
    """

    count: Tensor
    excess: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        free_index: int = 8,
        ignore_index: int = 255,
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
        self.add_tables(**dict.fromkeys(("count", "excess"), (*parts, num_classes, num_classes)))

    def frame_tables(
        self,
        preds: F.Preds,
        target: F.Labels,
        velocity: F.Velocity,
        mask: F.Mask | None = None,
        visible: F.Mask | None = None,
    ) -> Tables:
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
    ) -> Tables:
        """Returns ``count`` and ``excess`` of every frame, from its codes (`functional.encode`)."""
        tables = F.confusion_tables(
            codes,
            self.shell,
            [self.penalty.excess_table(self.shell_m, v).to(codes.device) for v in speeds_mps],
            [self.part_of(*frame) for frame in zip(speeds_mps, visible.flatten(1))],
            math.prod(self.parts),
            self.num_classes,
            self.backend,
        )

        shape = (len(codes), *self.count.shape)
        return {name: table.reshape(shape) for name, table in zip(("count", "excess"), tables)}

    def part_of(self, speed_mps: float, visible: Bool[Tensor, "v"]) -> Int[Tensor, "v"] | None:
        """Returns the part of space of every voxel, numbered row by row.

        ``None`` stands for all of it in one part.
        """
        return None
