"""What every score of voxels against voxels shares: a grid, classes, the penalty, two tables."""

from collections.abc import Mapping
from typing import Any

from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .tables import TableMetric, Tables


class PenalizedConfusion(TableMetric):
    """Two [target, prediction] tables over a data set: voxels, and their excess penalties.

    The arguments are those of `KARMeanIoU`; a subclass adds `scores`. One that sorts voxels into
    bins of their distance gives ``n_bins`` and overrides `_bins`, and one that keeps marked voxels
    apart sets ``by_mark``: then the tables are [bins, c, c] or [2, bins, c, c], the marked second.
    ``more_tables`` are shapes of tables that it adds itself.
    """

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
        backend: str = "auto",
        *,
        n_bins: int | None = None,
        by_mark: bool = False,
        more_tables: Mapping[str, tuple[int, ...]] | None = None,
        **kwargs: Any,
    ) -> None:
        F.check_classes(num_classes, ignore_index, free_index)
        if backend not in F.BACKENDS:
            raise UserError(f"backend: {backend!r} is none of {', '.join(F.BACKENDS)}")
        sorted_by = (2,) * by_mark + ((n_bins,) if n_bins else ())
        shape = (*sorted_by, num_classes, num_classes)
        tables = {"count": shape, "excess": shape}
        super().__init__(tables | dict(more_tables or {}), **kwargs)
        self.grid = grid
        self.num_classes = num_classes
        self.free_index = free_index
        self.ignore_index = ignore_index
        self.penalty = F.Penalty(horizon_s, decay_per_s, penalty_scale, min_speed_mps)
        self.backend = backend
        self.n_bins = n_bins
        self.by_mark = by_mark
        # Not a buffer: a cast of the whole module to half precision must not round it.
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)

    def frame_tables(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        target: Int[Tensor, "b X Y Z"],
        velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
        mask: Bool[Tensor, "b X Y Z"] | None = None,
        marked: Bool[Tensor, "b X Y Z"] | None = None,
    ) -> Tables:
        """``count`` and ``excess`` of every frame.

        ``preds`` are class ids of any integer dtype or float logits, ``velocity`` the UAV's
        velocity or speed in m/s, ``mask`` restricts what is counted, and ``marked`` is told apart.
        Raises `UserError` for shapes that fit neither each other nor the grid, class ids out of
        range at counted voxels, and NaN in logits or velocities. A batch without a counted voxel
        is no error.
        """
        masks = {"mask": mask, "visible": marked}
        self._check(preds, target, masks)
        speeds_mps = F.speeds(velocity, batch=len(target))
        excess = self.penalty.excess_table(self.shell_m, speeds_mps).to(target.device)
        bins = self._bins(speeds_mps) if self.n_bins else None
        space = F.Space(self.shell, excess, bins, self.n_bins or 1)
        classes = F.Classes(self.num_classes, self.ignore_index)
        tables = F.confusion_tables(preds, target, mask, marked, space, classes, self.backend)
        shape = (len(target), *self.shapes["count"])
        return {name: table.reshape(shape) for name, table in zip(("count", "excess"), tables)}

    def _bins(self, speeds_mps: list[float]) -> Int[Tensor, "b s"]:
        """The bin of every distance in every frame."""
        raise NotImplementedError

    def _check(self, preds: Tensor, target: Tensor, masks: dict[str, Tensor | None]) -> None:
        for name, tensor in {"preds": preds, "target": target, **masks}.items():
            if tensor is not None and tensor.device != self.shell.device:
                raise UserError(
                    f"{name}: on {tensor.device}, but the metric is on {self.shell.device}; "
                    "move the metric with .to(device)"
                )
        F.check_shapes(preds, target, masks, self.grid.shape, self.num_classes)
