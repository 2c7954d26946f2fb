"""What an error would do to the flight: collisions missed, stops for nothing, thin things lost."""

import math
from typing import Any

import torch
from jaxtyping import Bool, Float, Int, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import CLASSES
from . import functional as F
from .confusion import PenalizedConfusion
from .tables import Scores, Tables

BLOCKED, MISSED, CLEAR, STOPPED = range(4)


class SafetyScores(PenalizedConfusion):
    """The safety suite. Occupied is every class but free; unknown voxels never count.

    The *bubble* is all within ``max(|v|, min_speed_mps) * horizon_s`` of the UAV. The *tube* is all
    within ``tube_radius_m`` of the straight path of the next ``tube_s`` at the current velocity.
    `compute` gives a dict of scalars in [0, 1], NaN where there was nothing to count:

    - ``false_free_rate``: of the truly occupied voxels in the bubble, the share predicted free,
    - ``collision_miss_rate``: of the truly occupied voxels in the tube, the share predicted free,
    - ``collision_miss_frames``: of the frames whose tube is truly occupied, the share in which no
      voxel of the tube was predicted occupied,
    - ``phantom_stop_rate``: of the frames whose tube is truly free, the share in which a voxel of
      it was predicted occupied,
    - ``phantom_voxel_rate``: of the truly free voxels in the tube, the share predicted occupied,
    - ``thin_recall`` and ``thin_recall_tolerant``: of the true voxels of thin structures, the share
      predicted so, and the share with such a prediction within ``thin_tolerance`` voxels of it,
    - ``geometric_iou``: IoU of occupied against free.

    Arguments as of `KARMeanIoU`, and

    Args:
        tube_radius_m: half the width of the UAV's body, with a margin.
        tube_s: how far ahead in time the tube reaches.
        thin_index: the class of thin structures.
        thin_tolerance: voxels by which a prediction of them may be off, diagonals included.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 3, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([8, 8, 8, 3]).view(1, 4, 1, 1)    # the wire 5 m ahead seen at 7 m
    >>> scores = SafetyScores(grid)
    >>> scores.update(preds, target, velocity=torch.tensor([[3.0, 0.0, 0.0]]))
    >>> found = scores.compute()
    >>> [float(found[name]) for name in ("collision_miss_rate", "thin_recall_tolerant")]
    [1.0, 1.0]
    """

    higher_is_better = None
    tube: Tensor
    frames: Tensor
    thin: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        tube_radius_m: float = 1.0,
        tube_s: float = 2.0,
        thin_index: int = CLASSES.index("thin_structure"),
        thin_tolerance: int = 1,
        **kwargs: Any,
    ) -> None:
        for name, value in (("tube_radius_m", tube_radius_m), ("tube_s", tube_s)):
            if not (math.isfinite(value) and value > 0):
                raise UserError(f"{name}: {value} must be a finite number above 0")
        if thin_tolerance < 0:
            raise UserError(f"thin_tolerance: {thin_tolerance} must be 0 or more voxels")
        super().__init__(
            grid,
            *arguments,
            n_bins=2,
            more_tables={"tube": (2, 2), "frames": (4,), "thin": (3,)},
            **kwargs,
        )
        if not 0 <= thin_index < self.num_classes:
            raise UserError(f"thin_index: {thin_index} must be 0 to {self.num_classes - 1}")
        self.tube_radius_m, self.tube_s = tube_radius_m, tube_s
        self.thin_index, self.thin_tolerance = thin_index, thin_tolerance

    def frame_tables(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Tables:
        """Tables of every frame.

        ``count`` and ``excess`` by whether in the bubble (first) or not; ``tube`` [truly occupied,
        predicted occupied]; ``frames`` by what their tube came to; ``thin`` voxels: all, found,
        found nearby. Raises `UserError` also for speeds: the tube needs the direction.
        """
        if velocity.shape != (len(target), 3):
            raise UserError(
                f"velocity: shape {list(velocity.shape)} is not [{len(target)}, 3]; the tube needs "
                "velocities in the occ frame, not speeds"
            )
        self._check(preds, target, {"mask": mask})
        labels = F.labels_of(preds)
        tables = super().frame_tables(labels, target, velocity, mask)
        known = target != self.ignore_index
        known = known if mask is None else known & mask
        frames = range(len(target))
        tubes = [self._tube(labels[n], target[n], known[n], velocity[n]) for n in frames]
        tables["tube"] = _stacked(tubes, self.tube)
        tables["frames"] = _stacked([_outcome(tube) for tube in tubes], self.frames)
        thin = [self._thin(labels[n], target[n], known[n]) for n in frames]
        tables["thin"] = _stacked(thin, self.thin)
        return tables

    def scores(self, tables: Tables) -> Scores:
        """The scores of tables as `frame_tables` gives them, summed."""
        bubble = tables["count"][..., 0, :, :]
        occupied = [c for c in range(self.num_classes) if c != self.free_index]
        tube, frames, thin = (tables[name].double() for name in ("tube", "frames", "thin"))
        return {
            "false_free_rate": bubble[..., occupied, self.free_index].sum(-1).double()
            / bubble[..., occupied, :].sum((-2, -1)).double(),
            "collision_miss_rate": tube[..., 1, 0] / tube[..., 1, :].sum(-1),
            "collision_miss_frames": frames[..., MISSED] / frames[..., BLOCKED],
            "phantom_stop_rate": frames[..., STOPPED] / frames[..., CLEAR],
            "phantom_voxel_rate": tube[..., 0, 1] / tube[..., 0, :].sum(-1),
            "thin_recall": thin[..., 1] / thin[..., 0],
            "thin_recall_tolerant": thin[..., 2] / thin[..., 0],
            "geometric_iou": F.geometric_iou(tables["count"].sum(-3), self.free_index),
        }

    def _bins(self, speeds_mps: list[float]) -> Int[Tensor, "b s"]:
        """0 in the bubble, 1 outside."""
        rows = [
            self.penalty.ttc_s(self.shell_m, speed) > self.penalty.horizon_s for speed in speeds_mps
        ]
        outside = torch.stack(rows) if rows else torch.zeros(0, len(self.shell_m))
        return outside.to(torch.int64).to(self.shell.device)

    def _tube(
        self,
        labels: Int[Tensor, "X Y Z"],
        target: Int[Tensor, "X Y Z"],
        known: Bool[Tensor, "X Y Z"],
        velocity: Float[Tensor, "3"],
    ) -> Int64[Tensor, "2 2"]:
        box, inside = F.swept_tube(self.grid, velocity, self.tube_s, self.tube_radius_m)
        inside = inside.to(target.device) & known[box]
        truly = target[box][inside] != self.free_index
        predicted = labels[box][inside] != self.free_index
        return torch.bincount(2 * truly.long() + predicted, minlength=4).view(2, 2)

    def _thin(
        self,
        labels: Int[Tensor, "X Y Z"],
        target: Int[Tensor, "X Y Z"],
        known: Bool[Tensor, "X Y Z"],
    ) -> Int64[Tensor, "3"]:
        true = known & (target == self.thin_index)
        found = known & (labels == self.thin_index)
        near = F.grown(found, self.thin_tolerance)
        return torch.stack([true.sum(), (true & found).sum(), (true & near).sum()])


def _outcome(tube: Int64[Tensor, "2 2"]) -> Int64[Tensor, "4"]:
    """What the tube of one frame says of the flight; nothing where none of it is known."""
    outcome = tube.new_zeros(4)
    predicted = tube[:, 1].sum() > 0
    if tube[1].sum() > 0:
        outcome[BLOCKED] = 1
        outcome[MISSED] = ~predicted
    elif tube[0].sum() > 0:
        outcome[CLEAR] = 1
        outcome[STOPPED] = predicted
    return outcome


def _stacked(rows: list[Int64[Tensor, "..."]], like: Tensor) -> Int64[Tensor, "b ..."]:
    return torch.stack(rows) if rows else like.new_zeros(0, *like.shape)
