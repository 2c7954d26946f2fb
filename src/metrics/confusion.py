"""The state that every score of this package is computed from."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F


class PenalizedConfusion(Metric):
    """Two int64 [target, prediction] tables over a data set: voxels, and their excess penalties.

    Counts accumulate over frames, so the scores are those of the data set, not means of frames, and
    are the same to the last bit whatever the batches and ranks. The arguments are those of
    `KARMeanIoU`; a subclass adds `compute`.
    """

    is_differentiable = False
    higher_is_better = True
    full_state_update = False

    count: Tensor
    excess: Tensor
    shell: Tensor

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
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        F.check_penalty(horizon_s, decay_per_s, penalty_scale, min_speed_mps)
        if not 2 <= num_classes <= F.MAX_CLASSES:
            raise UserError(f"num_classes: {num_classes} must be 2 to {F.MAX_CLASSES}")
        if not 0 <= free_index < num_classes:
            raise UserError(f"free_index: {free_index} must be 0 to {num_classes - 1}")
        self.grid = grid
        self.num_classes = num_classes
        self.free_index = free_index
        self.ignore_index = ignore_index
        self.penalty = {
            "horizon_s": horizon_s,
            "decay_per_s": decay_per_s,
            "penalty_scale": penalty_scale,
            "min_speed_mps": min_speed_mps,
        }
        # Not a buffer: a cast of the whole module to half precision must not round it.
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)
        table = torch.zeros(num_classes, num_classes, dtype=torch.int64)
        self.add_state("count", default=table.clone(), dist_reduce_fx="sum")
        self.add_state("excess", default=table.clone(), dist_reduce_fx="sum")

    def update(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> None:
        """Count a batch.

        ``preds`` are class ids of any integer dtype or float logits, ``velocity`` the UAV's
        velocity or speed in m/s, and ``mask`` restricts what is counted. Raises `UserError`, and
        leaves the tables as they were, for shapes that fit neither each other nor the grid, class
        ids out of range at counted voxels, and NaN in logits or velocities. A batch without a
        counted voxel is no error.
        """
        codes, speeds_mps = self._encode(preds, target, velocity, mask)
        excess = F.excess_table(self.shell_m, speeds_mps, **self.penalty)
        tables = F.confusion_update(codes, self.shell, excess.to(codes.device), self.num_classes)
        self.count, self.excess = self.count + tables[0], self.excess + tables[1]

    def forward(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Any:
        """`update`, and the score of this batch alone."""
        # The framework clears the state before it updates: a batch that raises then would lose it.
        self._encode(preds, target, velocity, mask)
        return super().forward(preds, target, velocity, mask)

    def _encode(
        self, preds: Tensor, target: Tensor, velocity: Tensor, mask: Tensor | None
    ) -> tuple[Tensor, list[float]]:
        for name, tensor in (("preds", preds), ("target", target), ("mask", mask)):
            if tensor is not None and tensor.device != self.shell.device:
                raise UserError(
                    f"{name}: on {tensor.device}, but the metric is on {self.shell.device}; "
                    "move the metric with .to(device)"
                )
        codes = F.encode(preds, target, mask, self.grid.shape, self.num_classes, self.ignore_index)
        return codes, F.speeds(velocity, batch=len(target))
