"""What an error would do to the flight: collisions missed, stops for nothing, thin things lost."""

from typing import Any

import torch
from jaxtyping import Bool, Int, Int64, UInt8
from torch import Tensor
from torch.nn.functional import max_pool3d

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_finite
from . import functional as F
from .count_metric import OUR_THIN, NamedCounts, Scores
from .functional.codes import UNCOUNTED
from .occupancy import ConfusionMetric

# The columns of ``frames``: what the tube of a frame truly was, and what was predicted.
BLOCKED, MISSED, CLEAR, STOPPED = range(4)


class SafetyScores(ConfusionMetric):
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

    It takes the arguments of `KARMeanIoU`, and

    Args:
        tube_radius_m: half the width of the UAV's body, with a margin.
        tube_s: how far ahead in time the tube reaches.
        thin_index: the class of thin structures.
        thin_tolerance: voxels by which a prediction of them may be off, diagonals included.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 3, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([8, 8, 8, 3]).view(1, 4, 1, 1)    # the wire 5 m ahead seen at 7 m
    >>> safety = SafetyScores(grid)
    >>> safety.update(preds, target, velocity=torch.tensor([[3.0, 0.0, 0.0]]))
    >>> scores = safety.compute()
    >>> [float(scores[name]) for name in ("collision_miss_rate", "thin_recall_tolerant")]
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
        thin_index: int = OUR_THIN,
        thin_tolerance: int = 1,
        **kwargs: Any,
    ) -> None:
        require_finite("tube_radius_m", tube_radius_m)
        require_finite("tube_s", tube_s)
        if thin_tolerance < 0:
            raise UserError(f"thin_tolerance: {thin_tolerance} must be 0 or more voxels")

        super().__init__(grid, *arguments, parts=(2,), **kwargs)
        self.add_counts(tube=(2, 2), frames=(4,), thin=(3,))
        self.require_said("thin_index", thin_index, "that of thin structures")
        self.tube_radius_m, self.tube_s = tube_radius_m, tube_s
        self.thin_index, self.thin_tolerance = thin_index, thin_tolerance

    def frame_counts(
        self, preds: F.Preds, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> NamedCounts:
        """Returns the counts of every frame.

        ``count`` and ``excess`` are sorted by whether in the bubble (first) or not; ``tube`` [truly
        occupied, predicted occupied]; ``frames`` by what their tube came to; ``thin`` voxels: all,
        hit, hit nearby. Raises `UserError` also for speeds: the tube needs the direction.
        """
        codes = self.codes(preds, target, mask)
        speeds_mps = F.speeds(velocity, len(target), directed="the tube")
        counts = self.stacked([{"tube": self._tube(*frame)} for frame in zip(codes, velocity)])
        counts |= self.confusion(codes, speeds_mps, torch.zeros_like(codes, dtype=torch.bool))
        return counts | {"frames": _outcomes(counts["tube"]), "thin": self._thin(codes)}

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        bubble = counts["count"][..., 0, :, :].double()
        occupied = [c for c in range(self.num_classes) if c != self.free_index]
        said_free = bubble[..., occupied, self.free_index].sum(-1)
        tube, frames, thin = (counts[name].double() for name in ("tube", "frames", "thin"))

        return {
            "false_free_rate": said_free / bubble[..., occupied, :].sum((-2, -1)),
            "collision_miss_rate": tube[..., 1, 0] / tube[..., 1, :].sum(-1),
            "collision_miss_frames": frames[..., MISSED] / frames[..., BLOCKED],
            "phantom_stop_rate": frames[..., STOPPED] / frames[..., CLEAR],
            "phantom_voxel_rate": tube[..., 0, 1] / tube[..., 0, :].sum(-1),
            "thin_recall": thin[..., 1] / thin[..., 0],
            "thin_recall_tolerant": thin[..., 2] / thin[..., 0],
            "geometric_iou": F.geometric_iou(counts["count"].sum(-3), self.free_index),
        }

    def part_of(self, speed_mps: float, visible: Bool[Tensor, "v"]) -> Int[Tensor, "v"]:
        """Returns 0 in the bubble, 1 outside."""
        outside = self.penalty.ttc_s(self.shell_m, speed_mps) > self.penalty.horizon_s
        return outside.to(visible.device, torch.int32).index_select(0, self.shell)

    def _tube(self, codes: F.Codes, velocity: F.Vector) -> Int64[Tensor, "2 2"]:
        box, inside = swept_tube(self.grid, velocity, self.tube_s, self.tube_radius_m)
        in_tube = codes[box][inside.to(codes.device)]
        counted = in_tube[in_tube != UNCOUNTED]
        truly, predicted = (counted >> 4) != self.free_index, (counted & 15) != self.free_index
        return torch.bincount(2 * truly.long() + predicted, minlength=4).view(2, 2)

    def _thin(self, codes: UInt8[Tensor, "b X Y Z"]) -> Int64[Tensor, "b 3"]:
        # No class is 15, which both halves of an uncounted voxel's code say.
        true, predicted = (codes >> 4) == self.thin_index, (codes & 15) == self.thin_index
        near = grown(predicted, self.thin_tolerance)
        voxels = (true, true & predicted, true & near)
        return torch.stack([each.sum((1, 2, 3)) for each in voxels], dim=1)


def _outcomes(tube: Int64[Tensor, "b 2 2"]) -> Int64[Tensor, "b 4"]:
    """Returns what the tubes of frames mean for the flight; zeros where none of it is known."""
    blocked = tube[:, 1].sum(-1) > 0
    clear = ~blocked & (tube[:, 0].sum(-1) > 0)
    predicted = tube[:, :, 1].sum(-1) > 0
    # In the order of BLOCKED, MISSED, CLEAR, STOPPED.
    outcomes = (blocked, blocked & ~predicted, clear, clear & predicted)
    return torch.stack(outcomes, dim=1).long()


def swept_tube(
    grid: VoxelGrid, velocity_mps: F.Vector, seconds: float, radius_m: float
) -> tuple[tuple[slice, ...], Bool[Tensor, "x y z"]]:
    """Returns the voxels whose center is within a radius of the path of the next seconds.

    The path is the straight line from the origin of the occ frame at the current velocity. Returns
    the box of indices around the tube, and which of its voxels belong to it. On the CPU.
    """
    end_m = velocity_mps.detach().double().cpu() * seconds

    # The tube is a small part of the grid: all that follows looks at the box around it alone.
    lower_m = torch.tensor(grid.lower_m, dtype=torch.float64)
    first = (end_m.clamp(max=0) - radius_m - lower_m) / grid.voxel_m
    last = (end_m.clamp(min=0) + radius_m - lower_m) / grid.voxel_m
    box = tuple(
        slice(max(0, int(a)), max(0, min(int(b) + 1, size)))
        for a, b, size in zip(first.floor().tolist(), last.floor().tolist(), grid.shape)
    )

    axes = [
        low + grid.voxel_m * (torch.arange(size, dtype=torch.float64)[side] + 0.5)
        for low, size, side in zip(lower_m, grid.shape, box)
    ]
    centers_m = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)

    # The nearest point of the path, as a share of its length; a UAV at rest has no path.
    length2 = end_m.square().sum()
    along = (centers_m @ end_m / length2).clamp(0, 1) if length2 > 0 else centers_m[..., 0] * 0
    distance2 = (centers_m - along[..., None] * end_m).square().sum(-1)
    return box, distance2 <= radius_m**2


def grown(shape: F.Mask, voxels: int) -> F.Mask:
    """Returns all within some voxels of a shape, diagonals included."""
    # The maximum over a cube is 1 where any of its voxels belongs to the shape.
    cube = max_pool3d(shape[:, None].float(), 2 * voxels + 1, stride=1, padding=voxels)
    return cube[:, 0].bool()
