"""What every score of voxels against voxels shares: the penalty, and two tables."""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from ..geometry import VoxelGrid
from . import functional as F
from .tables import Tables, VoxelMetric


class PenalizedConfusion(VoxelMetric):
    """Two [target, prediction] tables over a dataset: voxels, and their excess penalties.

    The arguments are those of `KARMeanIoU`; a subclass adds `scores`. One that sorts voxels into
    bins of their distance gives ``n_bins`` and overrides `_bins`, and one that keeps visible voxels
    apart sets ``by_visible``: then the tables are [bins, c, c] or [2, bins, c, c], the visible ones
    second. ``more_tables`` are shapes of tables that it adds itself.
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
        n_bins: int | None = None,
        by_visible: bool = False,
        more_tables: Mapping[str, tuple[int, ...]] | None = None,
        **kwargs: Any,
    ) -> None:
        shape: tuple[int, ...] = (num_classes, num_classes)
        if n_bins:
            shape = (n_bins, *shape)
        if by_visible:
            shape = (2, *shape)
        shapes = {"count": shape, "excess": shape, **(more_tables or {})}
        super().__init__(grid, shapes, num_classes, ignore_index, free_index, **kwargs)

        F.is_compiled(backend, torch.device("cpu"))  # raises for a backend that there is not
        self.backend = backend
        self.penalty = F.Penalty(horizon_s, decay_per_s, penalty_scale, min_speed_mps)
        self.n_bins, self.by_visible = n_bins, by_visible

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
        self.check(preds, target, mask=mask, visible=visible)
        speeds_mps = F.speeds(velocity, batch=len(target))
        if not self.by_visible:
            visible = None
        elif visible is None:
            visible = torch.zeros_like(target, dtype=torch.bool)

        bins = None
        if self.n_bins:
            bins = [self._bins(speed).to(target.device, torch.int32) for speed in speeds_mps]
        frames = F.Frames(
            labels=F.labels_of(preds),
            target=target,
            shell=self.shell,
            excess=self.penalty.excess_table(self.shell_m, speeds_mps).to(target.device),
            num_classes=self.num_classes,
            ignore_index=self.ignore_index,
            mask=mask,
            marked=visible,
            bins=bins,
            n_bins=self.n_bins or 1,
        )

        shape = (len(target), *self.shapes["count"])
        tables = F.confusion_tables(frames, self.backend)
        return {name: table.reshape(shape) for name, table in zip(("count", "excess"), tables)}

    def _bins(self, speed_mps: float) -> Int[Tensor, "s"]:
        """Returns the bin of every distance at this speed."""
        raise NotImplementedError
