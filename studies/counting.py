"""Predictions of the test split beside a run's own: counted by clip, written together, printed."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from src.atomic import replacing_folder
from src.data.batch import Batch
from src.metrics.by_clip import ByClip
from src.metrics.count_metric import CountMetric
from src.metrics.protocol import Protocol
from src.results.counts import Counts
from src.results.files import run_table, write_table
from src.results.render import Cell, Table, print_table
from src.run_folder import TALLIES

SCORE = "kar_miou"
Draw = Callable[[pd.DataFrame, Path], object]


class ClipCounts:
    """Counts, clip by clip, what one prediction says of frames of the test split."""

    def __init__(self, name: str, metric: CountMetric, clips: Sequence[str]) -> None:
        self.name, self.metric = name, ByClip(metric, clips)
        self.frames: Counter[str] = Counter()

    def add(
        self, batch: Batch, labels: UInt8[Tensor, "b X Y Z"], holds: Bool[Tensor, "b"] | None = None
    ) -> None:
        """Counts the labels of a batch; where ``holds`` is given, of the frames that it says."""
        rows = torch.arange(len(labels)) if holds is None else holds.nonzero()[:, 0]
        if len(rows):
            clips = [batch["clip"][row] for row in rows.tolist()]
            target = (batch[key][rows] for key in ("semantics", "velocity_mps"))
            self.metric.update(clips, labels[rows], *target)
            self.frames.update(clips)

    def counts(self, protocol: Protocol) -> Counts:
        """Returns the counts, under a protocol."""
        clips, counted = self.metric.clips, {"occupancy": self.metric.of_clips()}
        return Counts(self.name, protocol, clips, [self.frames[clip] for clip in clips], counted)


def scores_of(counts: Sequence[Counts], column: str) -> pd.DataFrame:
    """Returns a row for each score of each of the counts, whose names stand in a column, with the
    score's interval over clips."""
    scores = run_table({0: counts}, {"test": lambda clip: True})
    scores = scores.drop(columns=["seed", "condition", "part", "protocol"])
    return scores.rename(columns={"experiment": column})


def write_counted(
    folder: Path, name: str, counts: Sequence[Counts], table: pd.DataFrame, draw: Draw
) -> None:
    """Writes the counts, the table as ``<name>.csv``, and a figure of its KAR-mIoU."""
    # As a whole, so that no counts of an earlier call stay.
    with replacing_folder(folder) as new:
        for each in counts:
            each.write(new / TALLIES / f"{each.name}.npz")
        draw(table[table["score"] == SCORE], new / f"{name}.png")
        write_table(table, new / f"{name}.csv")


def print_scores(
    table: pd.DataFrame, column: str, title: str, scores: Mapping[str, str], *beside: str
) -> None:
    """Prints some scores in percent, by the names that head them, with their intervals over clips;
    and ``beside`` them other columns of the table."""
    rows = []
    for name, of_name in table.groupby(column, sort=False):
        values = of_name.set_index("score")[["value", "low", "high"]]
        texts = [str(of_name[each].iloc[0]) for each in beside]
        rows.append((str(name), [*texts, *(Cell(*(100 * values.loc[score])) for score in scores)]))
    print_table(Table(column, title, "", [*beside, *scores.values()], rows, column))
