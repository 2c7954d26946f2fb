"""A part of the test split by tilt, or all of it under a wrongly measured attitude."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from ..data.batch import Batch
from ..errors import UserError
from ..metrics.by_clip import ByClip
from ..metrics.protocol import Protocol
from ..metrics.tables import TableMetric
from ..metrics.tally import Tally
from ..report.attitude_evidence import TRUE


@dataclass(frozen=True)
class Condition:
    """Frames with a tilt from ``low_deg`` on and below ``high_deg``, told an attitude with
    ``noise_deg`` and ``delay_s``, or a ``level`` one (`MeasuredAttitude`). The tilt is
    |roll| + |pitch|, the true ones.
    """

    low_deg: float = 0.0
    high_deg: float = math.inf
    noise_deg: float = 0.0
    delay_s: float = 0.0
    level: bool = False

    @property
    def fault(self) -> tuple[float, float, bool]:
        """What is wrong with the attitude that is told."""
        return self.noise_deg, self.delay_s, self.level

    @property
    def name(self) -> str:
        """For files: ``true``, ``tilt_5_10deg``, ``noise_3deg``, ``delay_0.2s``, ``level``,
        ``level_tilt_5_10deg``."""
        parts = [f"noise_{self.noise_deg:g}deg"] if self.noise_deg else []
        parts += [f"delay_{self.delay_s:g}s"] if self.delay_s else []
        parts += ["level"] if self.level else []
        if self.low_deg > 0 or self.high_deg < math.inf:
            parts += [f"tilt_{self.low_deg:g}_{self.high_deg:g}deg"]
        return "_".join(parts) or TRUE

    def holds(self, batch: Batch) -> Bool[Tensor, "b"]:
        """Which frames of a batch, with its true attitude, belong here."""
        tilt_deg = torch.rad2deg(batch["attitude_rad"].abs().sum(dim=-1))
        return (tilt_deg >= self.low_deg) & (tilt_deg < self.high_deg)


def conditions_of(
    tilt_edges_deg: Sequence[float],
    noise_deg: Sequence[float],
    delay_s: Sequence[float],
    level: bool,
) -> Iterator[Condition]:
    """All frames; each bin of tilt; all frames under each noise, and under each delay; and, with
    ``level``, all frames and each bin once more, told a UAV that flies level.

    Raises `UserError` for edges that do not ascend from above zero, for values that are not above
    zero, and for two that have one name.
    """
    edges = [0.0, *tilt_edges_deg]
    if any(not high > low for low, high in pairwise(edges)):
        raise UserError(f"task.tilt_edges_deg: {list(tilt_edges_deg)}; give ascending ones above 0")
    for name, values in {"noise_deg": noise_deg, "delay_s": delay_s}.items():
        if any(not 0 < value < math.inf for value in values):
            raise UserError(f"task.{name}: {list(values)}; give values above 0")
    listed = {"tilt_edges_deg": tilt_edges_deg, "noise_deg": noise_deg, "delay_s": delay_s}
    for name, values in listed.items():
        if len({f"{value:g}" for value in values}) < len(values):
            raise UserError(f"task.{name}: {list(values)}; give values of which no two are alike")
    bins = [Condition()]
    if len(edges) > 1:
        bins += [Condition(*bounds) for bounds in zip(edges, [*edges[1:], math.inf])]
    yield from bins
    yield from (Condition(noise_deg=value) for value in noise_deg)
    yield from (Condition(delay_s=value) for value in delay_s)
    if level:
        yield from (replace(condition, level=True) for condition in bins)


class ConditionCount:
    """What is counted, clip by clip, of the frames of a condition."""

    def __init__(self, condition: Condition, metric: TableMetric, clips: Sequence[str]) -> None:
        self.condition = condition
        self.metric = ByClip(metric, clips)
        self.frames: Counter[str] = Counter()

    def add(self, batch: Batch, labels: UInt8[Tensor, "b X Y Z"]) -> None:
        """Count those frames of a batch, with its true attitude, that belong here."""
        rows = self.condition.holds(batch).nonzero()[:, 0]
        if not len(rows):
            return
        clips = [batch["clip"][row] for row in rows.tolist()]
        truth = (batch[key][rows] for key in ("semantics", "velocity_mps"))
        self.metric.update(clips, labels[rows], *truth)
        self.frames.update(clips)

    def tally(self, whole: Protocol) -> Tally:
        """The counts, with the protocol of the whole split narrowed to this condition."""
        frames = [self.frames[clip] for clip in self.metric.clips]
        name = self.condition.name
        protocol = replace(whole, part=f"{whole.part}, {name}", frames=sum(frames))
        tables = {"occupancy": self.metric.tables()}
        return Tally(name, protocol, self.metric.clips, frames, tables)
