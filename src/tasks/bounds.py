"""task=bounds: floor and ceiling of a dataset's scores, without any training."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import get_args

import pandas as pd
import torch
from hydra.utils import instantiate
from jaxtyping import UInt8
from omegaconf import DictConfig
from torch import Tensor

from ..atomic_folder import replacing_folder
from ..audit.true_sight import By, TrueSight
from ..data.batch import Batch
from ..data.measured_attitude import MeasuredAttitude
from ..metrics.by_clip import ByClip
from ..metrics.protocol import Protocol
from ..metrics.tables import TableMetric
from ..results.counts import Counts
from ..results.files import write_table
from ..results.render import Cell, Table, print_table
from ..results.table import run_table
from ..run_folder import TALLIES
from ..terminal import say, tracked
from .evaluate import Anchor, anchors_of
from .model import origin_of
from .scoring import clips_of, protocol_of
from .session import Session

TABLE, FIGURE = "bounds.csv", "bounds.png"
SCORE = "kar_miou"
# The scores that are printed, and their names.
PRINTED = {"miou_occupied": "mIoU occupied", SCORE: "KAR-mIoU"}

Predict = Callable[[Batch], UInt8[Tensor, "b X Y Z"]]


@dataclass(frozen=True)
class Sight:
    """How a perfect sight is made worse. Its fields are columns of ``bounds.csv``."""

    images: int = 1
    depth_error: float = 0.0
    by: By = "image"
    attitude_deg: float = 0.0
    level: bool = False

    @property
    def name(self) -> str:
        """The sight in words, as sight, depth_5%_by_pixel or images_4."""
        parts = [f"images_{self.images}"] if self.images > 1 else []
        by = "_by_pixel" if self.by == "pixel" else ""
        parts += [f"depth_{100 * self.depth_error:g}%{by}"] if self.depth_error else []
        parts += [f"attitude_{self.attitude_deg:g}deg"] if self.attitude_deg else []
        return "_".join(parts + ["level"] * self.level) or "sight"


def bounds(
    cfg: DictConfig,
    depth_error: Sequence[float],
    attitude_deg: Sequence[float],
    seed: int,
    out: str,
) -> None:
    """Writes ``bounds.csv``, the counts of each bound and ``bounds.png`` to ``out``.

    The floors are the anchors that stand beside every run. The ceilings are those of `TrueSight`:
    of the current frame and of the queue of ``data.frames``, with each ``depth_error``, smooth and
    by pixel, told the true attitude and that of level flight, and with each ``attitude_deg`` of
    noise on roll and pitch. All are scored on the test split.

    Raises `UserError` for data without depth images, and as `TrueSight` and `MeasuredAttitude` do.
    """
    session = Session(cfg)
    sights = list(dict.fromkeys(_sights(depth_error, attitude_deg, cfg.data.frames)))
    counters = _counters(session, sights, seed)
    samples = session.data.split["test"]
    for batch in tracked(session.data.in_order("test"), "scoring"):
        for counter in counters:
            counter.add(batch)

    protocol = protocol_of(cfg, session.data, len(samples))
    counts = [counter.counts(protocol) for counter in counters]
    table = _described(counts, sights)
    # As a whole, so that no counts of an earlier call's bounds stay.
    with replacing_folder(Path(out)) as folder:
        for each in counts:
            each.write(folder / TALLIES / f"{each.name}.npz")
        # Scoring needs no drawing code; it is loaded for the figure alone.
        from ..report.bounds import draw_bounds

        draw_bounds(table[table["score"] == SCORE], folder / FIGURE)
        write_table(table, folder / TABLE)
    print_table(_printed(table))
    say(out)


def _sights(
    depth_error: Sequence[float], attitude_deg: Sequence[float], queue: int
) -> Iterator[Sight]:
    """Yields the ceilings, from the highest down."""
    yield Sight(images=queue)
    for error, level, by in product((0.0, *depth_error), (False, True), get_args(By)):
        if error or by == "image":
            yield Sight(depth_error=error, by=by, level=level)
    for noise_deg in attitude_deg:
        yield Sight(attitude_deg=noise_deg)


class Counter:
    """Counts the test split under one prediction."""

    def __init__(self, name: str, predict: Predict, metric: TableMetric, clips: list[str]) -> None:
        self.name, self.predict = name, predict
        self.metric, self.frames = ByClip(metric, clips), dict.fromkeys(clips, 0)

    def add(self, batch: Batch) -> None:
        labels = self.predict(batch)
        self.metric.update(batch["clip"], labels, batch["semantics"], batch["velocity_mps"])
        for clip in batch["clip"]:
            self.frames[clip] += 1

    def counts(self, protocol: Protocol) -> Counts:
        tables = {"occupancy": self.metric.tables()}
        return Counts(self.name, protocol, self.metric.clips, list(self.frames.values()), tables)


def _counters(session: Session, sights: Sequence[Sight], seed: int) -> list[Counter]:
    cfg, data = session.cfg, session.data
    clips = {clip: data.clips[clip] for clip in clips_of(data.split["test"])}
    step = data.dataset("test").step

    def seen(sight: Sight) -> Predict:
        true = TrueSight(clips, step, sight.images, sight.depth_error, sight.by, seed)
        told = MeasuredAttitude(clips, step, sight.attitude_deg, 0.0, seed, sight.level)
        return lambda batch: true(told(batch))

    def blind(anchor: Anchor) -> Predict:
        return lambda batch: torch.stack([anchor(layer) for layer in data.layers(batch)])

    # What is wrong with the settings is refused before the labels are read.
    ceilings = {sight.name: seen(sight) for sight in sights}
    floors = anchors_of(origin_of(cfg, data, session.folder))
    predictions = {name: blind(anchor) for name, anchor in floors.items()} | ceilings
    metric = instantiate(cfg.metric)
    return [
        Counter(name, predict, metric(data.grid), list(clips))
        for name, predict in predictions.items()
    ]


def _described(counts: Sequence[Counts], sights: Sequence[Sight]) -> pd.DataFrame:
    """Returns a row for each bound, part of the split and score, with its interval over clips.

    What a floor's row says of a sight is empty.
    """
    scores = run_table({0: counts}, {"test": lambda clip: True})
    scores = scores.drop(columns=["seed", "condition", "part", "protocol"])
    scores = scores.rename(columns={"experiment": "bound"})
    facts = pd.DataFrame([{"bound": sight.name, **asdict(sight)} for sight in sights])
    return scores.merge(facts, on="bound", how="left")


def _printed(table: pd.DataFrame) -> Table:
    """Returns the main scores of every bound in percent, with their intervals over clips."""
    rows = []
    for name, of_bound in table.groupby("bound", sort=False):
        scores = of_bound.set_index("score")[["value", "low", "high"]]
        rows.append((str(name), [Cell(*(100 * scores.loc[score])) for score in PRINTED]))
    title = "Scores (%) of what sees nothing, and of what sees the pixels' true depth and class"
    return Table("bounds", title, "", list(PRINTED.values()), rows, "bound")
