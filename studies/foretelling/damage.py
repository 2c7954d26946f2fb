"""What each damage to the truth costs of two scores, by its amount.

    python -m studies.foretelling.damage [--out FOLDER] [OVERRIDE...]

Lets a UAV fly that knows the truth, on maps of their own, while every damage looks on. Writes
``damage.csv``: kind, amount, mIoU of what is occupied and KAR-mIoU, and prints for each kind the
amounts at which each of the two is at its targets, where it gets there. ``flight.yaml`` beside this
file has them: damages of one mIoU and different KAR-mIoU, and the reverse.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import torch
from omegaconf import OmegaConf

from src.loop.campaign import Campaign, Job
from src.loop.flight import Moment
from src.loop.stage import Stage
from src.results.files import write_table
from src.results.frame_scores import FrameScores
from src.terminal import tracked
from studies.foretelling.damaged import Damaged
from studies.settings import composed, run
from studies.tables import print_table

MISSIONS = ["mission.first_seed=500", "mission.maps=8", "mission.conflict=2", "mission.clear=1"]
SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
AMOUNTS = {
    **dict.fromkeys(("voxels", "objects", "thin_structure", "vru", "building"), SHARES),
    "phantoms": (0.002, 0.01, 0.03, 0.1, 0.3),
    "near": (4.0, 7.0, 10.0, 14.0, 18.0),
    "far": (6.0, 10.0, 14.0, 18.0, 22.0),
    "ahead": (0.5, 1.0, 1.5, 2.0, 3.0),
    "grown": (0.5, 1.0, 1.5),
}
TARGETS = {"miou_occupied": (0.8, 0.6, 0.4), "kar_miou": (0.7, 0.5)}


class Watchers:
    """Shows a flight to all damages."""

    def __init__(self, stage: Stage, config: dict, campaign: Campaign) -> None:
        self.of = {
            (kind, amount): FrameScores(
                stage, config, Damaged(kind, campaign.grid, kind, amount, seed=0)
            )
            for kind, amounts in AMOUNTS.items()
            for amount in amounts
        }

    def __call__(self, moment: Moment) -> None:
        for each in self.of.values():
            each(moment)


def main(*overrides: str, out: Path = Path(__file__).parent) -> None:
    words = ["task=fly", "perception=truth", *MISSIONS, *overrides]
    config = OmegaConf.to_container(composed(words), resolve=True)
    torch.set_num_threads(1)
    campaign, tables = Campaign(config), {}
    places = campaign.missions.places()
    jobs = [Job.of(row) for place in tracked(places, "choosing") for row in campaign.choose(*place)]
    for job in tracked(jobs, "flying"):
        _, watchers = campaign.watched(job, lambda stage: Watchers(stage, config, campaign))
        for key, scores in watchers.of.items():
            counts = scores.counts(job.mission.flight)
            summed = tables.setdefault(key, {})
            for name, table in counts.tables["occupancy"].items():
                summed[name] = summed.get(name, 0) + table[0]

    rows, metric = [], counts.suite().metric("occupancy")
    for (kind, amount), summed in tables.items():
        scores = metric.scores(summed)
        values = {name: round(float(scores[name]), 4) for name in ("miou_occupied", "kar_miou")}
        rows.append({"kind": kind, "amount": amount, **values})
    table = pd.DataFrame(rows)
    write_table(table, out / "damage.csv")
    for score, targets in TARGETS.items():
        columns = ("kind", *(f"{target:.0%}" for target in targets))
        print_table(f"amounts at which {score} is so much", columns, _reached(table, score))


def _reached(table: pd.DataFrame, score: str) -> list[tuple[str, ...]]:
    """Returns for each kind the amounts at which a score is at its targets, by straight lines
    between those that were tried."""
    rows = []
    for kind, of_kind in table.groupby("kind", sort=False):
        # A longer sight and more of what is lost go different ways: the score must rise.
        ordered = of_kind.sort_values(score)
        scores, amounts = ordered[score].to_numpy(), ordered["amount"].to_numpy()
        cells = [
            f"{np.interp(target, scores, amounts):.3g}"
            if scores[0] <= target <= scores[-1]
            else "-"
            for target in TARGETS[score]
        ]
        rows.append((str(kind), *cells))
    return rows


if __name__ == "__main__":
    run(main)
