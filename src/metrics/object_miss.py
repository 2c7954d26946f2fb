"""Whole objects on the UAV's way of which the prediction shows nothing."""

import math
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_positive
from ..ontology import GROUND
from . import functional as F
from .safety import swept_tube
from .tables import Scores, Sums, Tables, VoxelMetric


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
        ground_index: int = GROUND,
        **kwargs: Any,
    ) -> None:
        require_positive({"near_m": near_m, "seconds": seconds})
        if not (math.isfinite(tolerance_m) and tolerance_m >= 0):
            raise UserError(f"tolerance_m: {tolerance_m} must be a finite number, 0 or more")
        super().__init__(grid, *arguments, **kwargs)
        self.near_m, self.seconds = near_m, seconds
        self.tolerance_m, self.ground_index = tolerance_m, ground_index
        self.add_tables(objects=(self.num_classes, 2))

    def frame_tables(
        self, preds: F.Preds, target: F.Labels, velocity: F.Velocity, mask: F.Mask | None = None
    ) -> Tables:
        """Returns of every frame the ``objects`` near the way [class, whether missed]. Raises
        `UserError` also for speeds: the way needs the direction."""
        codes = self.codes(preds, target, mask)
        F.require_directions(velocity, len(target), "the way")
        F.speeds(velocity, batch=len(target))
        return self.stacked([{"objects": self._frame(*each)} for each in zip(codes, velocity)])

    def scores(self, tables: Sums) -> Scores:
        """Returns the scores of tables as `frame_tables` gives them, summed."""
        objects = tables["objects"].double()
        of_class = objects[..., 1] / objects.sum(-1)
        rates = {
            f"object_miss_rate/{name}": of_class[..., n]
            for n, name in enumerate(self.class_names)
            if n not in (self.free_index, self.ground_index)
        }
        return {"object_miss_rate": objects[..., 1].sum(-1) / objects.sum((-2, -1)), **rates}

    def _frame(
        self, codes: UInt8[Tensor, "X Y Z"], velocity_mps: Float[Tensor, "3"]
    ) -> Int64[Tensor, "c 2"]:
        # Only here: importing the compiler takes a second.
        from .functional.kernels import count_objects

        near = np.zeros(codes.shape, dtype=bool)
        box, inside = swept_tube(self.grid, velocity_mps, self.seconds, self.near_m)
        near[box] = inside.numpy()
        around = F.within(self.tolerance_m / self.grid.voxel_m)
        objects = np.zeros((self.num_classes, 2), np.int64)
        seen = codes.cpu().contiguous().numpy()
        skipped = self.free_index, self.ground_index
        count_objects(seen, near, around, *skipped, objects)
        return torch.from_numpy(objects)
