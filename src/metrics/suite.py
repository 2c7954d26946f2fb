"""All scores of a data set from one pass, kept apart by clip."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict

from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .breakdown import KARBreakdown
from .by_clip import ByClip
from .calibration import Calibration
from .occupancy import OccupancyScores
from .protocol import Protocol
from .ray_iou import RayIoU
from .safety import SafetyScores
from .sensitivity import KARSensitivity
from .tables import Tables

FLAT = ("occupancy", "breakdown", "safety", "rays", "calibration")
"""The metrics whose scores stand in the table of a run; the rest has tables of its own."""


class Truth(TypedDict, total=False):
    """What a batch of predictions is scored against. Only the first three must be there."""

    clip: Sequence[str]
    semantics: Int[Tensor, "b X Y Z"]
    velocity_mps: Float[Tensor, "b 3"]
    """In the occ frame."""
    visible: Bool[Tensor, "b X Y Z"]
    mask: Bool[Tensor, "b X Y Z"]
    """Restricts what is counted."""
    camera_from_occ: Float[Tensor, "b 4 4"]
    pix_from_camera: Float[Tensor, "b 3 3"]
    size_pix: tuple[int, int]


class ScoreSuite(nn.Module):
    """Every metric of this package, configured alike.

    Rays are scored where the truth names its cameras, calibration where there are logits.

    Args:
        grid: the voxels of the labels.
        clips: ids of all clips that may come.
        metric: arguments of `OccupancyScores`.
        suite: ``ttc_edges_s``, ``distance_edges_m``, ``tube_radius_m``, ``tube_s``,
            ``thin_tolerance``, ``calibration_bins``, ``ray_thresholds_m``, ``rays`` (across, down)
            and ``sensitivity`` (values by parameter); and, of the intervals, ``resamples``,
            ``level`` and ``seed``.

    Raises `UserError` for settings that a score could not be computed with.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        clips: Sequence[str],
        metric: Mapping[str, Any],
        suite: Mapping[str, Any],
    ) -> None:
        super().__init__()
        _require_sound(suite)
        metric = {key: value for key, value in metric.items() if not key.startswith("_")}
        classes = {key: metric[key] for key in ("num_classes", "free_index", "ignore_index")}
        known = {key: metric[key] for key in ("num_classes", "ignore_index")}
        bubble = {key: metric[key] for key in ("horizon_s", "min_speed_mps")}
        ttc, distance = suite["ttc_edges_s"], suite["distance_edges_m"]
        tube = {key: suite[key] for key in ("tube_radius_m", "tube_s", "thin_tolerance")}
        metrics = {
            "occupancy": OccupancyScores(grid, **metric),
            "breakdown": KARBreakdown(grid, **metric, ttc_edges_s=ttc, distance_edges_m=distance),
            "safety": SafetyScores(grid, **metric, **tube),
            "rays": RayIoU(grid, **classes, thresholds_m=suite["ray_thresholds_m"]),
            "calibration": Calibration(grid, **known, **bubble, bins=suite["calibration_bins"]),
            "sensitivity": KARSensitivity(grid, suite["sensitivity"], **classes),
        }
        self.rays = tuple(suite["rays"])
        self.clips = list(clips)
        self.by_clip = nn.ModuleDict(
            {name: ByClip(metric, self.clips) for name, metric in metrics.items()}
        )

    @classmethod
    def of(cls, protocol: Protocol, clips: Sequence[str]) -> "ScoreSuite":
        """The metrics that a protocol describes."""
        return cls(protocol.voxel_grid, clips, protocol.metric, protocol.suite)

    def metric(self, name: str) -> Any:
        """One of the metrics: what its tables mean. Its own state is empty."""
        return self.by_clip[name].metric

    def update(
        self,
        preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
        truth: Truth,
        logits: Float[Tensor, "b c X Y Z"] | None = None,
    ) -> None:
        """Count a batch of labels or logits; beside labels ``logits`` may be given, for the
        calibration alone. Raises `UserError` as the metrics do."""
        clip, target, velocity = (truth[key] for key in ("clip", "semantics", "velocity_mps"))
        labels, mask = F.labels_of(preds), truth.get("mask")
        self.by_clip["occupancy"].update(clip, labels, target, velocity, mask)
        self.by_clip["breakdown"].update(clip, labels, target, velocity, mask, truth.get("visible"))
        self.by_clip["safety"].update(clip, labels, target, velocity, mask)
        self.by_clip["sensitivity"].update(clip, labels, target, velocity, mask)
        if preds.is_floating_point():
            logits = preds
        if logits is not None:
            self.by_clip["calibration"].update(clip, logits, target, velocity, mask)
        if "camera_from_occ" in truth:
            camera = (truth["camera_from_occ"], truth["pix_from_camera"], truth["size_pix"])
            rays = F.camera_rays(*camera, self.rays)
            self.by_clip["rays"].update(clip, labels, target, *rays, mask)

    def tables(self) -> dict[str, Tables]:
        """The tables [clips, ...] of every metric that was asked to count."""
        asked = {name: metric for name, metric in self.by_clip.items() if metric.update_called}
        return {name: metric.tables() for name, metric in asked.items()}

    def scores(self, chosen: Callable[[str], bool] = lambda clip: True) -> dict[str, float]:
        """All scores of the chosen clips together, by name; without the sensitivity."""
        return {
            score: float(value)
            for name in FLAT
            if self.by_clip[name].update_called
            for score, value in self.by_clip[name].scores(chosen).items()
        }


def _require_sound(suite: Mapping[str, Any]) -> None:
    """Of the settings that no metric is built with."""
    rays, resamples, level = suite["rays"], suite["resamples"], suite["level"]
    if len(rays) != 2 or not all(isinstance(number, int) and number > 0 for number in rays):
        raise UserError(f"suite.rays: {list(rays)} must be two whole numbers, across and down")
    if resamples < 1:
        raise UserError(f"suite.resamples: {resamples} must be 1 or more")
    if not 0 < level < 1:
        raise UserError(f"suite.level: {level} must be between 0 and 1, as 0.95")
