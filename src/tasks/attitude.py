"""task=attitude: a checkpoint's scores by the UAV's tilt, and under a wrongly measured attitude."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from ..atomic_folder import replacing_folder
from ..data.datamodule import SkyShieldData
from ..data.dataset import history_stride
from ..data.measured_attitude import MeasuredAttitude
from ..metrics.tally import Tally
from ..report.attitude import SCORE, draw_attitude, print_attitude
from ..report.attitude_evidence import ATTITUDE, TABLE
from ..report.scores import score_table, write_table
from ..run_folder import TALLIES
from ..terminal import say, tracked
from .condition import Condition, ConditionCount, conditions_of
from .predictor import Predictor, predictor
from .scoring import clips_of, protocol_of
from .session import Session


def attitude(
    cfg: DictConfig,
    tilt_edges_deg: Sequence[float],
    noise_deg: Sequence[float],
    delay_s: Sequence[float],
    seed: int,
    level: bool,
) -> None:
    """Writes ``<run>/attitude/``: ``attitude.csv``, a tally a condition, and a figure.

    Raises `UserError` as `Session` and `conditions_of` do.
    """
    conditions = list(conditions_of(tilt_edges_deg, noise_deg, delay_s, level))
    session = Session(cfg)
    trainer, run = session.trainer, session.folder
    checkpoint, data = session.checkpoint("attitude"), session.data
    counts = _counts(conditions, cfg, data)
    _count(counts, data, predictor(checkpoint.network(), trainer), seed)
    protocol = protocol_of(cfg, data, len(data.split["test"]))
    tallies = [count.tally(protocol) for count in counts]
    table = _described(tallies, conditions, seed)
    # As a whole, so that no tally of an earlier call's conditions stays.
    with replacing_folder(run.path / ATTITUDE) as folder:
        for tally in tallies:
            tally.write(folder / TALLIES / f"{tally.name}.npz")
        draw_attitude({cfg.name: table[table["score"] == SCORE]}, folder / "attitude.png")
        write_table(table, folder / TABLE)
    print_attitude(table)
    say(run.path / ATTITUDE)


def _counts(
    conditions: Sequence[Condition], cfg: DictConfig, data: SkyShieldData
) -> list[ConditionCount]:
    metric, clips = instantiate(cfg.metric), clips_of(data.split["test"])
    return [ConditionCount(condition, metric(data.grid), clips) for condition in conditions]


def _count(
    counts: Sequence[ConditionCount], data: SkyShieldData, scores_of: Predictor, seed: int
) -> None:
    """Counts the test split under every condition; each wrong attitude is predicted with once."""
    of_fault = defaultdict(list)
    for count in counts:
        of_fault[count.condition.fault].append(count)
    clips = {clip: data.clips[clip] for clip in clips_of(data.split["test"])}
    capture_hz = next(iter(clips.values())).meta.capture_hz
    step = history_stride(data.history_step_s, capture_hz)
    told = {
        (noise_deg, delay_s, level): MeasuredAttitude(clips, step, noise_deg, delay_s, seed, level)
        for noise_deg, delay_s, level in of_fault
    }
    for batch in tracked(data.in_order("test"), "scoring"):
        for fault, measured in told.items():
            labels = scores_of(measured(batch)).argmax(dim=1).to(torch.uint8).cpu()
            for count in of_fault[fault]:
                count.add(batch, labels)


def _described(
    tallies: Sequence[Tally], conditions: Sequence[Condition], noise_seed: int
) -> pd.DataFrame:
    """A row for each condition and score, with its interval over clips."""
    scores = score_table(tallies, {"test": lambda clip: True})
    scores = scores.drop(columns="split").rename(columns={"experiment": "condition"})
    facts = pd.DataFrame([{"condition": each.name, **asdict(each)} for each in conditions])
    facts = facts.rename(columns={"low_deg": "tilt_low_deg", "high_deg": "tilt_high_deg"})
    return facts.assign(noise_seed=noise_seed).merge(scores, on="condition")
