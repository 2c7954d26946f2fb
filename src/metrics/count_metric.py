"""Metrics whose whole state is a few named counts: tensors of integers."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import wraps
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64, UInt8
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from ..geometry import VoxelGrid, tensor_of
from ..ontology import CLASSES, FREE, GROUND, NUM_CLASSES, THIN_STRUCTURE
from ..provenance import digest_of
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
    these two functions. The suite, and collections of torchmetrics, read from the names of the
    arguments of `frame_counts` what to feed it with (`ScoreSuite.update`).

    Metrics of other arguments never share their counts in a collection, nor merge into each other.
    """

    is_differentiable = False
    full_state_update = False
    higher_is_better = True

    # Whether its scores stand in the table of a run's scores. Many numbers that are to be read
    # together, as a sensitivity, have a table of their own.
    in_score_table = True

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in vars(cls):
            cls.__init__ = _recording(cls.__init__)
        if "frame_counts" in vars(cls):
            cls.update = _updating(cls.frame_counts)

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], **kwargs: Any) -> None:
        """``shapes`` are those of the counts, by name."""
        super().__init__(**kwargs)
        # A collection updates only one of the metrics whose states have equal names and, after the
        # first batch, equal values. So one state, always 0, is named after how the metric was made.
        made = digest_of([type(self).__module__, type(self).__qualname__, vars(self).get(MADE, {})])
        self._mark = f"made_{made}"
        self.add_counts(**{self._mark: ()}, **shapes)

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
        """Everything counted so far.

        Raises `UserError` where a metric of one's own keeps something else under a count's name.
        """
        counts = {name: each for name, each in self.metric_state.items() if name != self._mark}
        for name, each in counts.items():
            if not (isinstance(each, Tensor) and each.shape == self._defaults[name].shape):
                raise UserError(
                    f"self.{name}: holds the count of this name; call what is kept there otherwise"
                )
        return counts

    def update(self, *batch: Any, **options: Any) -> None:
        """Adds the counts of a batch; the arguments are those of `frame_counts`, or arrays."""
        batch, options = self._tensors(batch, options)
        try:
            counts = self.frame_counts(*batch, **options)
            if unknown := counts.keys() - self._defaults.keys():
                names = ", ".join(self.counts)
                raise UserError(
                    f"frame_counts: gives {min(unknown)!r}, and the metric counts {names}"
                )
        except Exception:
            self._update_count -= 1  # the framework counts the call before it is made
            raise

        for name, of_frames in counts.items():
            setattr(self, name, self.added(getattr(self, name), of_frames, *batch))

    def merge_state(self, incoming_state: "dict[str, Any] | Metric") -> None:
        """Adds what another metric, made with the same arguments, has counted.

        Raises `UserError` for the state of another metric, or of other arguments.
        """
        given = incoming_state if isinstance(incoming_state, dict) else incoming_state.metric_state
        if given.keys() != self.metric_state.keys():
            raise UserError(
                "merge_state: counts of another metric, or of one made with other arguments; merge "
                "metrics that were made alike"
            )
        super().merge_state(incoming_state)

    def added(
        self, total: Int64[Tensor, "..."], of_frames: Int64[Tensor, "b ..."], *batch: Any
    ) -> Int64[Tensor, "..."]:
        """Adds what the frames of a batch count to what was counted before."""
        return total + of_frames.sum(0)

    def forward(self, *batch: Any, **options: Any) -> Any:
        """Adds the counts of a batch, and returns the scores of this batch alone."""
        batch, options = self._tensors(batch, options)
        # The framework clears the state before it updates: a batch that raises then would lose it.
        self.frame_counts(*batch, **options)
        return super().forward(*batch, **options)

    def _tensors(self, batch: tuple, options: Mapping[str, Any]) -> tuple[tuple, dict[str, Any]]:
        """Returns the arguments with tensors on the metric's device in the place of arrays."""

        def tensor(value: Any) -> Any:
            return tensor_of(value).to(self.device) if isinstance(value, np.ndarray) else value

        return tuple(map(tensor, batch)), {name: tensor(each) for name, each in options.items()}

    def compute(self) -> Any:
        """Returns the scores of everything counted so far."""
        return {name: score.float() for name, score in self.scores(self.counts).items()}


class _Ours(int):
    """The id of one of our classes, where nobody has said another."""


OURS, OUR_GROUND, OUR_THIN = _Ours(FREE), _Ours(GROUND), _Ours(THIN_STRUCTURE)


def _unsaid(name: str, what: str, num_classes: int) -> UserError:
    return UserError(
        f"{name}: which of the {num_classes} classes is {what}? It is known of our {NUM_CLASSES} "
        "alone"
    )


# In the ``__dict__`` of a metric: the arguments of its constructors.
MADE = "_made_with"


def _recording(init: Callable[..., None]) -> Callable[..., None]:
    """Wraps a constructor so that its arguments are known when that of `CountMetric` is reached."""

    @wraps(init)
    def recording(self: CountMetric, *arguments: Any, **options: Any) -> None:
        signature = inspect.signature(init)
        bound = signature.bind(self, *arguments, **options)
        bound.apply_defaults()
        made = self.__dict__.setdefault(MADE, {})
        named = list(signature.parameters)[1:]
        made[init.__qualname__] = {name: _plain(bound.arguments[name]) for name in named}
        init(self, *arguments, **options)

    return recording


def _updating(frame_counts: Callable[..., NamedCounts]) -> Callable[..., None]:
    """Returns `CountMetric.update` under the signature of a metric's own `frame_counts`."""

    @wraps(CountMetric.update)
    def update(self: CountMetric, *batch: Any, **options: Any) -> None:
        CountMetric.update(self, *batch, **options)

    update.__signature__ = inspect.signature(frame_counts)
    return update


def _plain(argument: Any) -> Any:
    """Returns an argument as plain data, in which equal numbers are equal."""
    if isinstance(argument, CountMetric):
        return vars(argument)[MADE]
    if isinstance(argument, Mapping):
        return {str(key): _plain(each) for key, each in argument.items()}
    if isinstance(argument, np.ndarray | Tensor):
        # In text, long ones are cut.
        return [str(argument.dtype), _plain(argument.tolist())]
    if isinstance(argument, list | tuple):
        return [_plain(each) for each in argument]
    if isinstance(argument, VoxelGrid):
        return _plain(vars(argument))
    return float(argument) if isinstance(argument, int | float) else repr(argument)


class VoxelMetric(CountMetric):
    """A `CountMetric` whose batches are labels, or logits, on one grid.

    ``shell_m`` are the distinct distances of voxels from the UAV, and ``shell`` says which of them
    each voxel has. A subclass adds its counts with `add_counts`. With ``ignore_index=None`` every
    label counts. Raises `UserError` for class ids that cannot be told apart, for more classes than
    four bits hold (`functional.codes`), and for other classes than ours without a ``free_index``.
    """

    shell: Tensor
    # Whether it tells free space from what is occupied.
    knows_free = True

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int = 9,
        free_index: int = OURS,
        ignore_index: int | None = 255,
        **kwargs: Any,
    ) -> None:
        if not 2 <= num_classes <= MAX_CLASSES:
            raise UserError(
                f"num_classes: {num_classes} must be 2 to {MAX_CLASSES}, as a voxel's label and "
                "prediction share one byte; join classes first"
            )
        if free_index is OURS and num_classes != NUM_CLASSES and self.knows_free:
            raise _unsaid("free_index", "free space", num_classes)
        if self.knows_free and not 0 <= free_index < num_classes:
            raise UserError(f"free_index: {free_index} must be 0 to {num_classes - 1}")
        if ignore_index is not None and 0 <= ignore_index < num_classes:
            raise UserError(f"ignore_index: {ignore_index} is a class; give another number")

        super().__init__({}, **kwargs)
        self.grid = grid
        self.num_classes, self.ignore_index = num_classes, ignore_index
        self.free_index = free_index if self.knows_free else None
        # The ontology's names, or the ids where there are more or fewer classes.
        ids = map(str, range(num_classes))
        self.class_names = CLASSES if num_classes == NUM_CLASSES else tuple(ids)

        # Distances are no buffer: a cast of the whole module to half precision must not round them.
        self.shell_m, shell = F.distance_shells(grid)
        self.register_buffer("shell", shell, persistent=False)

    def require_said(self, name: str, index: int, what: str) -> None:
        """Raises `UserError` for the id of one of our classes where there are others, and for one
        that there is not."""
        if isinstance(index, _Ours) and self.num_classes != NUM_CLASSES:
            raise _unsaid(name, what, self.num_classes)
        if not 0 <= index < self.num_classes:
            raise UserError(f"{name}: {index} must be 0 to {self.num_classes - 1}")

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
            hint = "; labels are integers" if of_logits and preds.shape == target.shape else ""
            raise UserError(f"preds: {kind} of shape {list(preds.shape)} must be {wanted}{hint}")

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
