"""Objects near the UAV's path without any predicted voxel."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Int64
from torch import Tensor

from ..geometry import VoxelGrid
from ..limits import require_finite
from . import functional as F
from .count_metric import OUR_GROUND, NamedCounts, Scores, VoxelMetric
from .safety import swept_tube


class ObjectMiss(VoxelMetric):
    """Objects that the UAV comes near and that have no predicted voxel.

    An object is a set of true voxels of one class that touch, be it by a corner; the ground is
    none. The UAV comes near it if the center of a voxel of it is within ``near_m`` of the straight
    path of the next ``seconds`` at the current velocity. It is missed if no voxel within
    ``tolerance_m`` of it is predicted, of any class but the ground; voxels that truly hold another
    class speak for that one alone. Distances are between centers. `compute` gives

    - ``object_miss_rate``: the share of the objects near in their frame that are missed,
    - ``object_miss_rate/<class>``: the same of those of a class.

    It takes the arguments of `VoxelMetric`. Raises `UserError` for lengths of no meaning.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 3, 8, 5]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([8, 8, 8, 2]).view(1, 4, 1, 1)    # the wire is not seen, the car is
    >>> objects = ObjectMiss(grid)
    >>> objects.update(preds, target, velocity=torch.tensor([[3.0, 0.0, 0.0]]))
    >>> float(objects.compute()["object_miss_rate"])
    0.5
    """

    higher_is_better = False
    objects: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        near_m: float = 2.0,
        seconds: float = 3.0,
        tolerance_m: float = 0.5,
        ground_index: int = OUR_GROUND,
        **kwargs: Any,
    ) -> None:
        require_finite("near_m", near_m)
        require_finite("seconds", seconds)
        require_finite("tolerance_m", tolerance_m, zero=True)

        super().__init__(grid, *arguments, **kwargs)
        self.require_said("ground_index", ground_index, "the ground")
        self.near_m, self.seconds = near_m, seconds
        self.tolerance_m, self.ground_index = tolerance_m, ground_index
        self.add_counts(objects=(self.num_classes, 2))

    def frame_counts(
        self, preds: F.Preds, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> NamedCounts:
        """Returns of every frame the ``objects`` near the way [class, whether missed]. Raises
        `UserError` also for speeds: the way needs the direction."""
        codes = self.codes(preds, target, mask)
        F.speeds(velocity, len(target), directed="the way")
        return self.stacked([{"objects": self._frame(*each)} for each in zip(codes, velocity)])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        objects = counts["objects"].double()
        missed, every = objects[..., 1], objects.sum(-1)
        none = self.free_index, self.ground_index
        of_classes = self.of_classes("object_miss_rate", missed / every, without=none)
        return {"object_miss_rate": missed.sum(-1) / every.sum(-1), **of_classes}

    def _frame(self, codes: F.Codes, velocity_mps: F.Vector) -> Int64[Tensor, "c 2"]:
        # Only here: importing the compiler takes a second.
        from .functional.kernels import count_objects

        near = np.zeros(codes.shape, dtype=bool)
        box, inside = swept_tube(self.grid, velocity_mps, self.seconds, self.near_m)
        near[box] = inside.numpy()
        around = F.within(self.tolerance_m / self.grid.voxel_m)
        objects = np.zeros((self.num_classes, 2), np.int64)
        codes = codes.cpu().contiguous().numpy()
        said = ~np.isin(codes & 15, (self.free_index, self.ground_index))
        arrays = codes, said.astype(np.int16), near
        count_objects(*arrays, around, self.free_index, self.ground_index, objects)
        return torch.from_numpy(objects[:, ::-1].copy())
