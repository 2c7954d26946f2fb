"""How much longer a stop is than what the plan before it had kept clear.

    python -m studies.uncertainty.stops [OVERRIDE...] [--out FILE]

Flies the missions of ``task=fly`` once as the planner is configured, and once with
``planner.keeps_stops=true``. A plan keeps clear its own way and a straight stop after it. Where
nothing is admissible any more, the length of the stop is compared with the rest of that.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import OmegaConf

from src.errors import UserError
from src.loop.campaign import Campaign, Job
from src.loop.flight import Moment
from src.loop.planner import STOPS, Plan, QuinticPlanner
from src.loop.stage import Stage
from src.results.files import write_table
from src.tasks.fly import given_missions
from src.terminal import say, tracked
from studies.settings import composed, run
from studies.tables import print_table

OUT = Path(__file__).with_name("stops.csv")


class Stops:
    """Watches a flight; ``longer_m`` is by how much each stop exceeds what was kept clear."""

    def __init__(self, planner: QuinticPlanner, plan_hz: float) -> None:
        factor = STOPS[0] if planner.keeps_stops else 1.0
        self._brake_mps2, self._step_s = planner.brake_mps2 / factor, 1 / plan_hz
        self._last: Plan | None = None
        self.longer_m: list[float] = []

    def __call__(self, moment: Moment) -> None:
        plan, last, self._last = moment.plan, self._last, moment.plan
        # One that is chosen may be as long as it likes.
        if plan.clear or last is None or last.stops:
            return
        pace_mps = np.linalg.norm(last.at(np.array([last.duration_s]))[0, 3:6])
        promised_m = length_m(last, self._step_s, last.duration_s)
        promised_m += pace_mps**2 / (2 * self._brake_mps2)
        self.longer_m.append(length_m(plan, 0.0, plan.duration_s) - promised_m)


def length_m(plan: Plan, from_s: float, until_s: float) -> float:
    """Returns the length of a part of a plan's way."""
    places_m = plan.at(np.linspace(from_s, until_s, 50))[:, :3]
    return float(np.linalg.norm(np.diff(places_m, axis=0), axis=1).sum())


def _stops_of(campaign: Campaign, stage: Stage) -> Stops:
    return Stops(campaign.planner, campaign.rules.plan_hz)


def main(*overrides: str, out: Path = OUT) -> None:
    rows = []
    for keeps in (False, True):
        words = ["task=fly", *overrides, f"planner.keeps_stops={str(keeps).lower()}"]
        config = OmegaConf.to_container(composed(words), resolve=True)
        campaign = Campaign(config)
        watch = partial(_stops_of, campaign)
        if (given := config["task"]["missions"]) is None:
            raise UserError("task.missions: give a file, as studies/uncertainty/missions.csv")
        missions = given_missions(Path(given), config["sim"]).to_dict("records")
        longer_m: list[float] = []
        for mission in tracked(missions, f"flying, keeps_stops={keeps}"):
            _, stops = campaign.watched(Job.of(mission), watch)
            longer_m += stops.longer_m
        row = {"keeps_stops": keeps, "flights": len(missions), "stops": len(longer_m)}
        row["largest_m"] = round(max(longer_m, default=np.nan), 3)
        row["longer"] = int((np.array(longer_m) > 0.01).sum())
        rows.append(row)
    write_table(pd.DataFrame(rows), out)
    shown = [[str(value) for value in row.values()] for row in rows]
    print_table("Stops longer than promised", list(rows[0]), shown)
    say(out)


if __name__ == "__main__":
    run(main)
