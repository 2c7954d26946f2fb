"""task=attitude: a checkpoint's scores by the UAV's tilt, and under a wrongly measured attitude."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
import torch
from hydra.utils import instantiate
from jaxtyping import UInt8
from omegaconf import DictConfig
from torch import Tensor

from ..atomic_folder import replacing_folder
from ..data.batch import Batch
from ..data.datamodule import SkyShieldData
from ..data.measured_attitude import MeasuredAttitude
from ..metrics.by_clip import ByClip
from ..metrics.protocol import Protocol
from ..metrics.tables import TableMetric
from ..results.conditions import ATTITUDE, TABLE, Condition, condition_table, conditions_of
from ..results.counts import Counts
from ..results.files import write_table
from ..results.render import Cell, Table, print_table
from ..results.table import run_table
from ..run_folder import TALLIES
from ..terminal import say, tracked
from .scoring import clips_of, protocol_of
from .session import Session
from .trainer import Predictor, predictor

SCORE = "kar_miou"
# The scores that are printed, and their names.
PRINTED = {"miou_occupied": "mIoU occupied", SCORE: "KAR-mIoU", "iou/thin_structure": "thin"}


def attitude(
    cfg: DictConfig,
    tilt_edges_deg: Sequence[float],
    noise_deg: Sequence[float],
    delay_s: Sequence[float],
    seed: int,
    level: bool,
) -> None:
    """Writes ``<run>/attitude/``: ``attitude.csv``, the counts of each condition, and a figure.

    Raises `UserError` as `Session` and `conditions_of` do.
    """
    conditions = list(conditions_of(tilt_edges_deg, noise_deg, delay_s, level))
    session = Session(cfg)
    trainer, run = session.trainer, session.folder
    checkpoint, data = session.checkpoint("attitude"), session.data

    metric, clips = instantiate(cfg.metric), clips_of(data.split["test"])
    counters = [ConditionCount(each, metric(data.grid), clips) for each in conditions]
    _count(counters, data, predictor(checkpoint.network(), trainer), seed)
    protocol = protocol_of(cfg, data, len(data.split["test"]))
    counts = [counter.counts(protocol) for counter in counters]

    table = _described(counts, conditions, seed)
    # As a whole, so that no counts of an earlier call's conditions stay.
    with replacing_folder(run.path / ATTITUDE) as folder:
        for each in counts:
            each.write(folder / TALLIES / f"{each.name}.npz")
        # Scoring needs no drawing code; it is loaded for the figure alone.
        from ..report.attitude import draw_attitude

        draw_attitude({cfg.name: table[table["score"] == SCORE]}, folder / "attitude.png")
        write_table(table, folder / TABLE)
    print_table(_printed(table))
    say(run.path / ATTITUDE)


class ConditionCount:
    """Counts, clip by clip, the frames of a condition."""

    def __init__(self, condition: Condition, metric: TableMetric, clips: Sequence[str]) -> None:
        self.condition = condition
        self.metric = ByClip(metric, clips)
        self.frames: Counter[str] = Counter()

    def add(self, batch: Batch, labels: UInt8[Tensor, "b X Y Z"]) -> None:
        """Counts those frames of a batch, with its true attitude, that belong here."""
        rows = self.condition.holds(batch).nonzero()[:, 0]
        if not len(rows):
            return
        clips = [batch["clip"][row] for row in rows.tolist()]
        target = (batch[key][rows] for key in ("semantics", "velocity_mps"))
        self.metric.update(clips, labels[rows], *target)
        self.frames.update(clips)

    def counts(self, whole: Protocol) -> Counts:
        """Returns the counts; their protocol is that of the whole split, narrowed to these."""
        frames = [self.frames[clip] for clip in self.metric.clips]
        name = self.condition.name
        protocol = replace(whole, part=f"{whole.part}, {name}", frames=sum(frames))
        tables = {"occupancy": self.metric.tables()}
        return Counts(name, protocol, self.metric.clips, frames, tables)


def _count(
    counters: Sequence[ConditionCount], data: SkyShieldData, scores_of: Predictor, seed: int
) -> None:
    """Counts the test split under every condition; each wrong attitude is predicted with once."""
    clips = {clip: data.clips[clip] for clip in clips_of(data.split["test"])}
    step = data.dataset("test").step
    faults = dict.fromkeys(counter.condition.fault for counter in counters)
    attitudes = {
        (noise_deg, delay_s, level): MeasuredAttitude(clips, step, noise_deg, delay_s, seed, level)
        for noise_deg, delay_s, level in faults
    }

    for batch in tracked(data.in_order("test"), "scoring"):
        for fault, measured in attitudes.items():
            labels = scores_of(measured(batch)).argmax(dim=1).to(torch.uint8).cpu()
            for counter in counters:
                if counter.condition.fault == fault:
                    counter.add(batch, labels)


def _described(
    counts: Sequence[Counts], conditions: Sequence[Condition], noise_seed: int
) -> pd.DataFrame:
    """Returns a row for each condition and score, with its interval over clips."""
    scores = run_table({0: counts}, {"test": lambda clip: True})
    scores = scores.drop(columns=["seed", "condition", "part", "protocol"])
    scores = scores.rename(columns={"experiment": "condition"})
    return condition_table(conditions, noise_seed).merge(scores, on="condition")


def _printed(table: pd.DataFrame) -> Table:
    """Returns the main scores of every condition in percent, with their intervals over clips."""
    rows = []
    for condition, of_condition in table.groupby("condition", sort=False):
        scores = of_condition.set_index("score")[["value", "low", "high"]]
        cells = [Cell(*(100 * scores.loc[name])) for name in PRINTED]
        rows.append((str(condition), [str(of_condition["frames"].iloc[0]), *cells]))

    title = "Scores (%) by tilt |roll| + |pitch|, and under a wrongly measured attitude"
    return Table("attitude", title, "", ["frames", *PRINTED.values()], rows, "condition")
