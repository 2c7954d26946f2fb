"""All scores of a dataset from one pass, kept apart by clip."""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, TypedDict

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..errors import UserError, reason_of
from ..geometry import VoxelGrid
from ..ontology import FREE, NUM_CLASSES
from . import functional as F
from .by_clip import ByClip
from .count_metric import CountMetric, NamedCounts
from .protocol import Protocol

# The metrics of conf/suite/default.yaml; any other one is a user's own.
STANDARD = ("occupancy", "breakdown", "safety", "primitives", "plans", "objects", "rays")
STANDARD += ("calibration", "occupied")


class GroundTruth(TypedDict, total=False):
    """The labels and the circumstances of a batch. Only the first three must be there."""

    clip: Sequence[str]
    semantics: Int[Tensor, "b X Y Z"]
    velocity_mps: Float[Tensor, "b 3"]  # in the occ frame
    visible: Bool[Tensor, "b X Y Z"]
    mask: Bool[Tensor, "b X Y Z"]  # restricts what is counted
    camera_from_occ: Float[Tensor, "b 4 4"]
    pix_from_camera: Float[Tensor, "b 3 3"]
    size_pix: tuple[int, int]
    occupied: Float[Tensor, "b X Y Z"]  # the probability, where there are no logits


# What a metric may ask for, by the names of the arguments of its `frame_counts`.
INPUTS = ("preds", "logits", "target", "velocity", *list(GroundTruth.__annotations__)[3:])


class ScoreSuite(nn.Module):
    """The metrics that a configuration names, by their names there.

    Args:
        grid: the voxels of the labels.
        clips: ids of all clips that may come.
        suite: ``metrics`` (for each name the path of a `CountMetric` as ``_target_``, and its
            arguments after the grid); and, of the intervals, ``resamples``, ``level`` and ``seed``.

    Raises `UserError` for settings that a score could not be computed with.
    """

    def __init__(self, grid: VoxelGrid, clips: Sequence[str], suite: Mapping[str, Any]) -> None:
        super().__init__()
        if suite["resamples"] < 1:
            raise UserError(f"suite.resamples: {suite['resamples']} must be 1 or more")
        if not 0 < suite["level"] < 1:
            raise UserError(f"suite.level: {suite['level']} must be between 0 and 1, as 0.95")

        self.clips = list(clips)
        self.by_clip = nn.ModuleDict()
        for name, entry in suite["metrics"].items():
            self.by_clip[name] = ByClip(_metric(name, entry, grid), self.clips)
        self._require_own_names()

    @classmethod
    def of(cls, protocol: Protocol, clips: Sequence[str]) -> "ScoreSuite":
        """Builds the metrics that a protocol describes.

        A protocol is read from a file, and no file says what to import, beyond a module of this
        checkout: raises `UserError` for a class that lies elsewhere and that the configuration
        (`import_metrics`) has not brought in.
        """
        if "metrics" not in protocol.suite:
            raise UserError("suite.metrics: not in these counts, which are older; score again")
        return cls(protocol.voxel_grid, clips, protocol.suite)

    def metric(self, name: str) -> Any:
        """Returns one of the metrics: what its counts mean. Its own state is empty."""
        return self.by_clip[name].metric

    def update(self, preds: F.Preds, truth: GroundTruth, logits: F.Logits | None = None) -> None:
        """Counts a batch of labels or logits; ``logits`` may be given beside labels.

        Each metric gets what its `frame_counts` names: ``preds`` (labels), ``logits``, ``target``,
        ``velocity`` and what else `GroundTruth` has. One that needs what the batch does not have,
        as logits or a camera, is not fed. Raises `UserError` as the metrics do.
        """
        batch = dict(truth, preds=F.labels_of(preds), target=truth["semantics"])
        batch["velocity"] = truth["velocity_mps"]
        if preds.is_floating_point():
            logits = preds
        if logits is not None:
            batch["logits"] = logits
            batch["occupied"] = 1 - logits.float().softmax(dim=1)[:, FREE]

        for metric in self.by_clip.values():
            required, wanted = _inputs(metric.metric)
            if required <= batch.keys():
                metric.update(truth["clip"], **{key: batch[key] for key in wanted & batch.keys()})

    def forget_partly_fed(self) -> list[str]:
        """Resets metrics that were fed with some of the batches only, and returns their names."""
        most = max(metric.update_count for metric in self.by_clip.values())
        partly = [name for name, metric in self.by_clip.items() if 0 < metric.update_count < most]
        for name in partly:
            self.by_clip[name].reset()
        return partly

    def counts(self) -> dict[str, NamedCounts]:
        """Returns the counts [clips, ...] of every metric that was fed."""
        fed = {name: metric for name, metric in self.by_clip.items() if metric.update_called}
        return {name: metric.of_clips() for name, metric in fed.items()}

    def scores(self, chosen: Callable[[str], bool] = lambda clip: True) -> dict[str, float]:
        """Returns all scores of the chosen clips together, by name, for the table of scores."""
        scores: dict[str, float] = {}
        for metric in self.by_clip.values():
            if metric.update_called and metric.metric.in_score_table:
                of_chosen = metric.scores(metric.of_clips(chosen))
                scores |= {name: float(value.float()) for name, value in of_chosen.items()}
        return scores

    def _require_own_names(self) -> None:
        """Two metrics may not name a score alike: one would hide the other."""
        owners: dict[str, str] = {}
        for name, by_clip in self.by_clip.items():
            for score in by_clip.metric.scores(by_clip.metric.counts):
                if owners.setdefault(score, name) != name:
                    raise UserError(f"suite.metrics.{name}: {score} is a score of {owners[score]}")


def require_sound(grid: VoxelGrid, suite: Mapping[str, Any]) -> None:
    """Builds the configured metrics, and scores one made-up frame with those of a user's own.

    Raises `UserError` that names what is wrong, before a training has taken its time.
    """
    frame = GroundTruth(
        clip=["clip"],
        semantics=torch.full((1, *grid.shape), FREE, dtype=torch.uint8),
        velocity_mps=torch.tensor([[5.0, 0.0, 0.0]]),
        visible=torch.ones(1, *grid.shape, dtype=torch.bool),
        camera_from_occ=torch.eye(4)[None],
        pix_from_camera=torch.tensor([[[50.0, 0.0, 50.0], [0.0, 50.0, 50.0], [0.0, 0.0, 1.0]]]),
        size_pix=(100, 100),
    )

    for name, entry in suite["metrics"].items():
        if name in STANDARD:
            continue
        try:
            alone = ScoreSuite(grid, ["clip"], {**suite, "metrics": {name: entry}})
            alone.update(torch.zeros(1, NUM_CLASSES, *grid.shape), frame)
            alone.scores()
        except UserError as error:
            if "suite." in str(error):  # it names its key itself
                raise
            raise UserError(f"suite.metrics.{name}: {error}") from error
        except Exception as error:  # whatever a class of a user's own raises
            raise UserError(
                f"suite.metrics.{name}: fails on a frame ({reason_of(error)}); what it is given, "
                "docs/metrics.md says"
            ) from error

    ScoreSuite(grid, [], suite)


def import_metrics(suite: Mapping[str, Any]) -> None:
    """Imports the modules of all metrics that the configuration names.

    Raises `UserError` for a module that there is not.
    """
    for name, entry in suite["metrics"].items():
        try:
            import_module(entry["_target_"].rpartition(".")[0])
        except (ImportError, ValueError) as error:
            raise UserError(f"suite.metrics.{name}._target_: {error}") from error


def _metric(name: str, entry: Mapping[str, Any], grid: VoxelGrid) -> CountMetric:
    """Builds a metric of a class of this checkout, or of one that was imported before."""
    module, _, attribute = entry["_target_"].rpartition(".")
    if module.startswith(f"{__name__.partition('.')[0]}."):
        with suppress(ImportError):
            import_module(module)
    make = getattr(sys.modules.get(module), attribute, None)
    if not (isinstance(make, type) and issubclass(make, CountMetric)):
        raise UserError(
            f"suite.metrics.{name}._target_: {entry['_target_']} is no CountMetric of this "
            "package, nor of a module that the configuration names"
        )

    arguments = {key: value for key, value in entry.items() if not key.startswith("_")}
    try:
        metric = make(grid, **arguments)
    except (TypeError, ValueError) as error:
        raise UserError(f"{error} (suite.metrics.{name})") from error
    if unknown := _inputs(metric)[0].difference(INPUTS):
        unknown = ", ".join(sorted(unknown))
        raise UserError(f"suite.metrics.{name}: asks for {unknown}; there are {', '.join(INPUTS)}")
    return metric


def _inputs(metric: CountMetric) -> tuple[set[str], set[str]]:
    """Returns the names of the inputs that a metric requires, and of all that it takes."""
    parameters = inspect.signature(metric.frame_counts).parameters
    required = {key for key, each in parameters.items() if each.default is each.empty}
    return required, set(parameters)
