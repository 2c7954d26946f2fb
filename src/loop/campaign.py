"""All that flies, and the missions that it flies, made from one configuration."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import TypeVar

import numpy as np
from hydra.utils import instantiate

from ..errors import UserError
from ..geometry import VoxelGrid
from ..sim.traffic import TrafficConfig
from ..sim.weather import Weather
from .airframe import States
from .belief import Fusion
from .camera import FlightCamera
from .flight import Rules, Watch, fly
from .mission import Mission
from .outcome import Row, row_of
from .perception import Truth
from .stage import GRID_REACH_M, Stage
from .twin import Twin

W = TypeVar("W", bound=Watch | None)

# The planner's settings while missions are selected.
CHOOSING = {"threshold": 0.5, "stops_in_known": False, "keeps_stops": False}
ROUTE = tuple(field.name for field in fields(Mission))

# The latest stage of this process, and what it was made of.
_latest: tuple[tuple, Stage] | None = None


@dataclass(frozen=True)
class Job:
    """A mission, its stratum, and the time that a UAV with the truth takes."""

    mission: Mission
    stratum: str
    truth_s: float

    @classmethod
    def of(cls, row: Mapping) -> "Job":
        """Returns the job of a row of ``missions.csv``."""
        mission = Mission(**{name: row[name] for name in ROUTE})
        return cls(mission, str(row["stratum"]), float(row["truth_s"]))


class Campaign:
    """All that flies: perception, planner, airframe and camera, made from a configuration.

    The ``pilot`` is the perception that is flown on: where the configured one only looks on, one
    that knows the truth.

    ``config`` is the composed configuration as plain data. Raises `UserError` where a part is set
    out of range, for a planner that is faster than the camera, and for a perception that knows
    other voxels than the task's.
    """

    def __init__(self, config: Mapping) -> None:
        task, sim = config["task"], config["sim"]
        self.grid = VoxelGrid(**task["grid"])
        self.rules = Rules(**task["rules"])
        if self.rules.plan_hz > sim["capture_hz"]:
            raise UserError(
                f"task.rules.plan_hz: {self.rules.plan_hz}; the camera takes sim.capture_hz="
                f"{sim['capture_hz']} frames a second, and each plan wants a new one"
            )

        # Traffic is not told where the UAV flies: nobody is left out who comes near it.
        self.traffic = TrafficConfig(**{**sim["traffic"], "uav_gap_m": 0.0})
        self.missions = instantiate(config["mission"])
        for weather in self.missions.weathers:
            Weather.of(sim, weather)  # for its refusals
        self.planner = instantiate(config["planner"])
        self.fusion = Fusion(**task.get("fusion", {}))
        # Missions are the same for every threshold, and however a UAV flies on what it knows.
        same = {key: each for key, each in CHOOSING.items() if key in config["planner"]}
        self.chooser = instantiate(config["planner"], **same)

        self.perception = instantiate(config["perception"], _partial_=True)(grid=self.grid)
        step_s, past = config["data"]["history_step_s"], config["data"].get("parallax")
        is_late = 1 / self.rules.plan_hz > step_s + 1e-9 and (past or config["data"]["frames"] > 1)
        if self.perception.wants_image and is_late:
            raise UserError(
                f"task.rules.plan_hz: {self.rules.plan_hz}; the network's past frames are "
                f"data.history_step_s={step_s} s apart, so none would be kept"
            )
        self._truth = Truth("truth", self.grid, in_sight=False)
        self.pilot = self._truth if task["looks_on"] else self.perception
        parts = {"airframe": instantiate(config["airframe"]), "camera": FlightCamera(sim)}
        self._fly = partial(fly, rules=self.rules, **parts)

    def choose(self, town: str, seed: int) -> list[Row]:
        """Returns the missions of a map, as rows of ``missions.csv``.

        A UAV that knows the truth arrives on all of them, in ``truth_s``. Raises `UserError` where
        none is in conflict though some should be.
        """
        wanted = {"conflict": self.missions.conflict, "clear": self.missions.clear}
        counts = dict.fromkeys(wanted, 0)
        rows: list[Row] = []
        for mission in self.missions.drawn(town, seed):
            stage = self._stage(mission, draws=False)
            hits = stage.blind_hits(self.planner.cruise_mps, self.rules.radius_m)
            stratum = "conflict" if hits else "clear"
            if counts[stratum] < wanted[stratum]:
                flown = self._fly(stage, self._truth, self.chooser)
                if flown.outcome == "arrived":
                    counts[stratum] += 1
                    row = {"flight": mission.flight, "stratum": stratum, **asdict(mission)}
                    rows.append({**row, "truth_s": flown.time_s})
            if counts == wanted:
                break

        if wanted["conflict"] and not counts["conflict"]:
            raise UserError(
                f"mission: no route of {town}-{seed} that can be flown is in conflict, of "
                f"{self.missions.tries} tried; raise mission.tries, or other mission.offset_m"
            )
        return rows

    def fly(self, job: Job) -> Row:
        """Flies a mission, and returns its row of ``flights.csv``."""
        return self.watched(job, lambda stage: None)[0]

    def watched(self, job: Job, make: Callable[[Stage], W], draws: bool = False) -> tuple[Row, W]:
        """Flies a mission, and returns its row and who watched it, whom ``make`` makes from its
        stage. There are images where the perception wants them, or it ``draws``."""
        draws = draws or self.perception.wants_image
        stage = self._stage(job.mission, draws)
        twin, watcher = Twin(self.grid, self.planner, self.rules, stage.truth), make(stage)
        watches = [twin] if watcher is None else [twin, watcher]
        options = {"watches": watches, "draws": draws, "fusion": self.fusion}
        flown = self._fly(stage, self.pilot, self.planner, **options)

        row = row_of(stage, flown, self.planner.threshold) | twin.row()
        of_job = {"stratum": job.stratum, "perception": self.pilot.name}
        mission = {name: getattr(job.mission, name) for name in ("flight", "map", "town")}
        return {**mission, **of_job, **row, "truth_s": job.truth_s}, watcher

    def flown_by_truth(self, job: Job) -> tuple[Stage, States]:
        """Flies a mission with the truth; returns its stage and the states, the first one too."""
        stage = self._stage(job.mission, draws=True)
        states = self._fly(stage, self._truth, self.chooser).states
        start_m = job.mission.at(np.array(0.0))
        first = self._fly.keywords["airframe"].at_rest(start_m, job.mission.yaw_rad)
        return stage, np.concatenate([first[None], states])

    def _stage(self, mission: Mission, draws: bool) -> Stage:
        seconds = self.rules.late_s + 1
        corner_m = np.abs([self.grid.lower_m, self.grid.upper_m]).max(axis=0)
        reach_m = max(GRID_REACH_M, float(np.linalg.norm(corner_m)))
        made_of = mission, self.traffic, self.planner.cruise_mps, seconds, draws, reach_m
        # Perceptions take turns on a mission, and its scene takes longer than a flight.
        global _latest
        if _latest is None or _latest[0] != made_of:
            _latest = made_of, Stage.of(*made_of)
        return _latest[1]
