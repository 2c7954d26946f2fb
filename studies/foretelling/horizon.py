"""The damages of ``flight.yaml`` scored on two grids: does KAR's horizon act where there is room?

    python -m studies.foretelling.horizon [--runs FOLDER] [--out FOLDER] [OVERRIDE...]

Of the voxels in the image of a level UAV, 90 % of the near grid of ``scale=ladder`` lie within the
25 m inside which every error weighs more, whatever the speed, and 15 % of the paper's. The UAV
that knows the truth flies the missions of the frames ``verge``, the damages look on once a second,
and each is scored on both grids on the same frames. No flight depends on it: the collisions are
those of ``flights.csv.xz``.

Writes the counts of every flight to ``--runs``, where they are not made again, and how each score
orders the damages, as ``task=foretell`` does, to ``<out>/horizon.csv``.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import torch
from omegaconf import OmegaConf

from src.geometry import VoxelGrid
from src.loop.campaign import Campaign, Job
from src.loop.flight import Moment
from src.loop.stage import MARGIN_M, Stage
from src.loop.true_occupancy import TrueOccupancy
from src.results.files import write_table
from src.results.flights import FLIGHTS
from src.results.frame_scores import FrameScores
from src.terminal import say, tracked
from studies.foretelling.correlation import FlownPerception, foretelling
from studies.foretelling.damaged import Damaged
from studies.foretelling.flight import PLAN
from studies.settings import composed, read_plan, run

# The sets of frames, and the scale whose grid each has.
SCALES = {"near": "ladder", "paper": "paper"}
# As far as a corner of the paper's grid.
REACH_M = np.array([57.0, 57.0, 30.0])
FLOWN = Path(__file__).with_name("flights.csv.xz")
REFERENCE = "seen"
SCORES = dict.fromkeys(("kar_miou", "miou", "miou_occupied"), "high")


# A kind and an amount.
Damage = tuple[str, float]


class OnceASecond:
    """Shows one frame of a second to all damages, on both grids."""

    def __init__(self, stage: Stage, configs: dict[str, dict], damages: dict[str, Damage]) -> None:
        ends_m = stage.mission.at(np.array([0.0, stage.mission.length_m]))
        reach_m = MARGIN_M + REACH_M
        corners = ends_m.min(axis=0) - reach_m, ends_m.max(axis=0) + reach_m
        wide = SimpleNamespace(mission=stage.mission, truth=TrueOccupancy(stage.scene, *corners))
        self._plans_a_second = round(configs["near"]["task"]["rules"]["plan_hz"])
        self._plans = 0
        self.of = {}
        for frames, config in configs.items():
            grid = VoxelGrid(**config["task"]["grid"])
            for name, (kind, amount) in damages.items():
                damaged = Damaged(name, grid, kind, amount, seed=0)
                self.of[name, frames] = FrameScores(wide, config, damaged)

    def __call__(self, moment: Moment) -> None:
        if self._plans % self._plans_a_second == 0:
            for each in self.of.values():
                each(moment)
        self._plans += 1


def main(
    *overrides: str, runs: Path = Path("runs/horizon"), out: Path = Path(__file__).parent
) -> None:
    plan = read_plan(PLAN, "overrides", "sets", "damaged")
    words = [*plan["overrides"], "perception=truth", *plan["sets"]["verge"], *overrides]
    config = OmegaConf.to_container(composed(words), resolve=True)
    config["suite"]["metrics"] = {"occupancy": config["suite"]["metrics"]["occupancy"]}
    configs = {
        frames: {**config, "task": {**config["task"], "grid": grid_of(scale)}}
        for frames, scale in SCALES.items()
    }
    torch.set_num_threads(1)

    damages = {
        f"{kind}_{amount}": (kind, amount)
        for kind, amounts in plan["damaged"].items()
        for amount in amounts
    }
    write_flights([*damages, REFERENCE], runs)
    campaign = Campaign(config)
    places = campaign.missions.places()
    jobs = [Job.of(row) for place in tracked(places, "choosing") for row in campaign.choose(*place)]
    for job in tracked(jobs, "looking on"):
        flight = job.mission.flight
        paths = {
            (name, frames): runs / "damaged" / name / frames / "frames" / f"{flight}.npz"
            for name in damages
            for frames in SCALES
        }
        if all(path.is_file() for path in paths.values()):
            continue
        _, watcher = campaign.watched(job, lambda stage: OnceASecond(stage, configs, damages))
        for key, scores in watcher.of.items():
            paths[key].parent.mkdir(parents=True, exist_ok=True)
            scores.counts(flight).write(paths[key])

    perceptions = FlownPerception.all_below([runs])
    generator = torch.Generator().manual_seed(0)
    table, standings = foretelling(perceptions, REFERENCE, SCORES, "kar_miou", 1000, generator)
    for frames, of_set in standings.groupby("frames"):
        ranks = of_set[list(SCORES)].rank().corr()
        say(f"{frames}: rank correlation of kar_miou and miou {ranks.loc['kar_miou', 'miou']:.4f}")
    write_table(standings, out / "horizon_scores.csv")
    kept = table[(table["target"] == "collisions") & (table["stratum"] == "damaged")]
    write_table(kept, out / "horizon.csv")
    say(kept[["frames", "score", "spearman", "low", "high", "difference"]].round(3).to_string())


def grid_of(scale: str) -> dict:
    return OmegaConf.to_container(composed([f"scale={scale}"])["grid"], resolve=True)


def write_flights(names: list[str], out: Path) -> None:
    """Writes the published flights of some perceptions, each to its folder."""
    flown = pd.read_csv(FLOWN, keep_default_na=False)
    own = flown[(flown["frames"] == "flown") & flown["name"].isin(names)]
    for (family, name), rows in own[own["threshold"] == 0.5].groupby(["family", "name"]):
        write_table(rows, out / family / name / "flown" / FLIGHTS)


if __name__ == "__main__":
    run(main)
