"""Metrics whose whole state is a few named counts: tensors of integers."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float, Float64, Int64, UInt8
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import CLASSES, NUM_CLASSES
from . import functional as F
from .functional.codes import MAX_CLASSES

# Float64 are weighted sums, where clips are resampled.
NamedCounts = Mapping[str, Int64[Tensor, "..."] | Float64[Tensor, "..."]]
Scores = dict[str, Float[Tensor, "..."]]


class CountMetric(Metric, ABC):
    """A metric that adds up int64 counts over the frames of a dataset.

    So its scores are those of the dataset, not means of frames, and equal to the last bit whatever
    the batches, their order and the ranks. What a batch adds (`frame_counts`) and what the scores
    of some counts are (`scores`) are functions of their own: `ByClip` keeps the counts of every
    clip apart with them. A batch that raises changes nothing.

    A metric of one's own gives ``shapes`` to the constructor, which gets the grid first, and writes
    these two functions. The suite reads from the names of the arguments of `frame_counts` what to
    feed it with (`ScoreSuite.update`).
    """

    is_differentiable = False
    full_state_update = False
    higher_is_better = True

    # Whether its scores stand in the table of a run's scores. Many numbers that are to be read
    # together, as a sensitivity, have a table of their own.
    in_score_table = True

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], **kwargs: Any) -> None:
        """``shapes`` are those of the counts, by name."""
        super().__init__(**kwargs)
        self.add_counts(**shapes)

    def add_counts(self, **shapes: tuple[int, ...]) -> None:
        """Begins the counts of these names, with zeros."""
        for name, shape in shapes.items():
            zeros = torch.zeros(shape, dtype=torch.int64)
            self.add_state(name, default=zeros, dist_reduce_fx="sum")

    @abstractmethod
    def frame_counts(self, *batch: Any, **options: Any) -> NamedCounts:
        """Returns the counts of every frame of a batch, stacked: [b, ...].

        Raises `UserError` for a batch that makes no sense, and then nothing has changed.
        """

    @abstractmethod
    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts [*n, ...], each [*n]: of many sums at once, if need be."""

    @property
    def counts(self) -> NamedCounts:
        """Everything counted so far."""
        return self.metric_state

    def update(self, *batch: Any, **options: Any) -> None:
        """Adds the counts of a batch; the arguments are those of `frame_counts`."""
        try:
            counts = self.frame_counts(*batch, **options)
        except Exception:
            self._update_count -= 1  # the framework counts the call before it is made
            raise
        for name, of_frames in counts.items():
            setattr(self, name, self.added(getattr(self, name), of_frames, *batch))

    def added(
        self, total: Int64[Tensor, "..."], of_frames: Int64[Tensor, "b ..."], *batch: Any
    ) -> Int64[Tensor, "..."]:
        """Adds what the frames of a batch count to what was counted before."""
        return total + of_frames.sum(0)

    def forward(self, *batch: Any, **options: Any) -> Any:
        """Adds the counts of a batch, and returns the scores of this batch alone."""
        # The framework clears the state before it updates: a batch that raises then would lose it.
        self.frame_counts(*batch, **options)
        return super().forward(*batch, **options)

    def compute(self) -> Any:
        """Returns the scores of everything counted so far."""
        return {name: score.float() for name, score in self.scores(self.counts).items()}


class VoxelMetric(CountMetric):
    """A `CountMetric` whose batches are labels, or logits, on one grid.

    ``shell_m`` are the distinct distances of voxels from the UAV, and ``shell`` says which of them
    each voxel has. A subclass adds its counts with `add_counts`. Raises `UserError` for class ids
    that cannot be told apart.
    """

    shell: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        free_index: int | None = 8,
        ignore_index: int = 255,
        **kwargs: Any,
    ) -> None:
        if not 2 <= num_classes <= MAX_CLASSES:
            raise UserError(f"num_classes: {num_classes} must be 2 to {MAX_CLASSES}")
        if free_index is not None and not 0 <= free_index < num_classes:
            raise UserError(f"free_index: {free_index} must be 0 to {num_classes - 1}")
        if 0 <= ignore_index < num_classes:
            raise UserError(f"ignore_index: {ignore_index} is a class; give another number")

        super().__init__({}, **kwargs)
        self.grid = grid
        self.num_classes, self.free_index, self.ignore_index = num_classes, free_index, ignore_index
        # The ontology's names, or the ids where there are more or fewer classes.
        ids = map(str, range(num_classes))
        self.class_names = CLASSES if num_classes == NUM_CLASSES else tuple(ids)

        # Distances are no buffer: a cast of the whole module to half precision must not round them.
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)

    def of_classes(
        self, score: str, values: Float[Tensor, "*n c"], without: Collection[int | None] = ()
    ) -> Scores:
        """Names the score of every class, ``without`` some of them: ``<score>/<class>``."""
        named = enumerate(self.class_names)
        return {f"{score}/{name}": values[..., n] for n, name in named if n not in without}

    def codes(
        self, preds: F.Preds, target: F.Labels, mask: F.Mask | None, **masks: F.Mask | None
    ) -> UInt8[Tensor, "b X Y Z"]:
        """Returns a byte per voxel (`functional.encode`).

        ``masks`` are others that the batch has, which are checked only. Raises `UserError` for
        tensors on another device than the metric, for shapes that do not fit each other or the
        grid, and for dtypes of neither labels nor logits, or of no mask.
        """
        masks = {name: each for name, each in {"mask": mask, **masks}.items() if each is not None}
        for name, tensor in {"preds": preds, "target": target, **masks}.items():
            if tensor.device != self.shell.device:
                raise UserError(
                    f"{name}: on {tensor.device}, but the metric is on {self.shell.device}; "
                    "move the metric with .to(device)"
                )

        shape = self.grid.shape
        if target.ndim != 4 or tuple(target.shape[1:]) != shape:
            raise UserError(
                f"target: shape {list(target.shape)} is not [B, X, Y, Z] of the grid {list(shape)}"
            )
        if target.is_floating_point() or target.dtype == torch.bool:
            raise UserError(f"target: {target.dtype} holds no class ids; give an integer dtype")
        for name, each in masks.items():
            if each.dtype != torch.bool or each.shape != target.shape:
                raise UserError(
                    f"{name}: {each.dtype} {list(each.shape)} must be bool {list(target.shape)}, "
                    "as the target"
                )

        if preds.dtype == torch.bool or preds.is_complex():
            raise UserError(f"preds: {preds.dtype} is neither integer labels nor float logits")
        of_logits = preds.is_floating_point()
        kind, classes = ("logits", [self.num_classes]) if of_logits else ("labels", [])
        wanted = [len(target), *classes, *shape]
        if list(preds.shape) != wanted:
            raise UserError(f"preds: {kind} of shape {list(preds.shape)} must be {wanted}")

        return F.encode(F.labels_of(preds), target, mask, self.num_classes, self.ignore_index)

    def stacked(self, frames: Sequence[NamedCounts]) -> NamedCounts:
        """Returns the counts of every frame, stacked; where there is no frame, all of the metric's
        own."""
        if not frames:
            return {name: each.new_zeros(0, *each.shape) for name, each in self.counts.items()}
        return {
            name: torch.stack([frame[name] for frame in frames]).to(self.shell.device)
            for name in frames[0]
        }
