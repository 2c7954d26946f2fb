"""task=attitude: a checkpoint's scores by the UAV's tilt, and under wrongly measured poses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from src.data.datamodule import SkyShieldData
from src.metrics.protocol import Protocol
from src.results.counts import Counts
from src.tasks.scoring import clips_of, protocol_of
from src.tasks.session import Session
from src.tasks.trainer import Predictor, predictor
from src.terminal import say, tracked
from studies.attitude.conditions import ATTITUDE, Condition, condition_table, conditions_of
from studies.attitude.measured_poses import MeasuredPoses
from studies.counting import SCORE, ClipCounts, print_scores, scores_of, write_counted

# The scores that are printed, and their names.
PRINTED = {"miou_occupied": "mIoU occupied", SCORE: "KAR-mIoU", "iou/thin_structure": "thin"}
TITLE = "Scores (%) by tilt |roll| + |pitch|, and under wrongly measured poses"


def attitude(
    cfg: DictConfig,
    tilt_edges_deg: Sequence[float],
    noise_deg: Sequence[float],
    delay_s: Sequence[float],
    seed: int,
    level: bool,
    distance_off: Sequence[float] = (),
    time_off_s: Sequence[float] = (),
) -> None:
    """Writes ``<run>/attitude/``: ``attitude.csv``, the counts of each condition, and a figure.

    Raises `UserError` as `Session` and `conditions_of` do.
    """
    faults = noise_deg, delay_s, level, distance_off, time_off_s
    conditions = list(conditions_of(tilt_edges_deg, *faults))
    session = Session(cfg)
    trainer, run = session.trainer, session.folder
    checkpoint, data = session.checkpoint("attitude"), session.data

    metric, clips = instantiate(cfg.metric), clips_of(data.split["test"])
    counters = {each: ClipCounts(each.name, metric(data.grid), clips) for each in conditions}
    _count(counters, data, predictor(checkpoint.network(), trainer), seed)
    protocol = protocol_of(cfg, data, len(data.split["test"]))
    counts = [replace(each, recipe=cfg.recipe_name) for each in narrowed(counters, protocol)]
    table = condition_table(conditions, seed).merge(scores_of(counts, "condition"), on="condition")

    # Scoring needs no drawing code; it is loaded for the figure alone.
    from studies.attitude.figure import draw_attitude

    folder = run.path / ATTITUDE
    write_counted(
        folder, "attitude", counts, table, lambda kar, path: draw_attitude({cfg.name: kar}, path)
    )
    print_scores(table, "condition", TITLE, PRINTED, "frames")
    say(folder)


def narrowed(counters: Mapping[Condition, ClipCounts], whole: Protocol) -> Iterator[Counts]:
    """Yields the counts; their protocols are that of the whole split, narrowed to their frames."""
    for counter in counters.values():
        part, frames = f"{whole.part}, {counter.name}", counter.frames.total()
        yield counter.counts(replace(whole, part=part, frames=frames))


def _count(
    counters: Mapping[Condition, ClipCounts], data: SkyShieldData, logits: Predictor, seed: int
) -> None:
    """Counts the test split under every condition; each fault is predicted with once."""
    faults = dict.fromkeys(condition.fault for condition in counters)
    poses = {fault: MeasuredPoses(data.dataset("test"), fault, seed) for fault in faults}

    for batch in tracked(data.in_order("test"), "scoring"):
        for fault, measured in poses.items():
            labels = logits(measured(batch)).argmax(dim=1).to(torch.uint8).cpu()
            for condition, counter in counters.items():
                if condition.fault == fault:
                    counter.add(batch, labels, condition.holds(batch))
