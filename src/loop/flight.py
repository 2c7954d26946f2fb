"""One flight in a closed loop: look, believe, plan, fly, until it arrives or does not."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..data.rates import STEP_HZ as SCENE_HZ
from ..errors import UserError
from ..geometry import world_from_occ
from ..limits import require_at_least, require_finite
from ..models.frame import StreamFrame
from .airframe import POSITION, STEP_HZ, Airframe, States
from .belief import Belief, BeliefMap, Fusion
from .camera import FlightCamera
from .obstacles import REACH_M, Nearest
from .perception import Perception
from .planner import Motion, Plan, Planner
from .stage import MARGIN_M, Stage
from .vectors import Vector

STEPS_A_SCENE_STEP = STEP_HZ // SCENE_HZ


class Moment(NamedTuple):
    """One planning step: frame, belief, state of the UAV, target and plan."""

    frame: StreamFrame
    belief: Belief
    motion: Motion
    target_m: Vector
    plan: Plan


Watch = Callable[[Moment], None]


@dataclass(frozen=True)
class Rules:
    """How a flight goes on and when it ends. Frames come and plans are made ``plan_hz`` times a
    second, and the target is so far ahead on the way. Raises `UserError` for what is out of range.
    """

    plan_hz: float = 5.0
    look_ahead_m: float = 15.0
    yaw_rate_radps: float = 1.2
    radius_m: float = 0.3
    arrived_m: float = 2.0
    aside_m: float = 8.0
    stuck_s: float = 5.0
    late_s: float = 30.0
    map_cells: tuple[int, int, int] = (80, 80, 32)
    forget_s: float = 0.5

    def __post_init__(self) -> None:
        numbers = {name: value for name, value in vars(self).items() if name != "map_cells"}
        require_at_least(0, "task.rules", numbers, *numbers)
        if self.plan_hz == 0 or (SCENE_HZ / self.plan_hz) % 1:
            raise UserError(
                f"task.rules.plan_hz: {self.plan_hz} does not divide the simulation's {SCENE_HZ} "
                "Hz; take 5, 2.5 or 2"
            )
        for name in ("forget_s", "stuck_s", "late_s"):
            require_finite(f"task.rules.{name}", numbers[name])


@dataclass(frozen=True)
class Flown:
    """The record of a flight: outcome, states at every step of the airframe, nearest obstacle, and
    the map's probability of occupied at the end of the flight, 2, 1 and 0.5 s earlier."""

    outcome: str
    states: States
    nearest: Nearest
    believed: tuple[float, float, float]
    halts: int

    @property
    def time_s(self) -> float:
        return len(self.states) / STEP_HZ

    @property
    def path_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.states[:, POSITION], axis=0), axis=1).sum())


def fly(
    stage: Stage,
    perception: Perception,
    planner: Planner,
    airframe: Airframe,
    camera: FlightCamera,
    rules: Rules,
    watches: Sequence[Watch] = (),
    draws: bool = False,
    fusion: Fusion | None = None,
) -> Flown:
    """Flies a mission. The same arguments give the same flight, bit for bit.

    ``watches`` are called with every moment at which a plan was made. There are images where the
    perception wants them, or it ``draws``. ``fusion`` says what a belief is worth to the map.
    """
    pilot = _Pilot(stage, planner, airframe, rules)
    believed = BeliefMap(rules.map_cells, perception.grid.voxel_m, rules.forget_s, fusion)
    perception.begin(stage.truth, stage.mission.flight)

    with camera.on(stage, perception.wants_image or draws) as look:
        while pilot.outcome is None:
            frame = look(pilot.time_s, pilot.state)
            belief = perception(frame)
            matrix = world_from_occ(frame.world_from_body)
            believed.update(belief, perception.grid, matrix, 1 / rules.plan_hz)
            moment = Moment(frame, belief, *pilot.fly_on(believed))
            for watch in watches:
                watch(moment)
    return pilot.flown()


class _Pilot:
    """Flies from frame to frame, and keeps the books."""

    def __init__(self, stage: Stage, planner: Planner, airframe: Airframe, rules: Rules) -> None:
        self._stage, self._planner, self._airframe, self._rules = stage, planner, airframe, rules
        mission = stage.mission
        start_m, still = mission.at(np.array(0.0)), np.zeros(3)
        self.state = airframe.at_rest(start_m, mission.yaw_rad)
        self._motion, self._yaw_rad = Motion(start_m, still, still), mission.yaw_rad
        self._steps = round(STEP_HZ / rules.plan_hz)
        self._wind = airframe.wind(mission.rng("wind"), round((rules.late_s + 1) * STEP_HZ))

        self.outcome: str | None = None
        self._plan: Plan | None = None
        self._states: list[States] = []
        self._flown_steps, self._halts = 0, 0
        self._nearest = Nearest(REACH_M, 255, 0)
        self._farthest_m, self._farthest_s = 0.0, 0.0
        self._maps: deque[BeliefMap] = deque(maxlen=round(2 * rules.plan_hz) + 1)

    @property
    def time_s(self) -> float:
        return self._flown_steps / STEP_HZ

    def fly_on(self, believed: BeliefMap) -> tuple[Motion, Vector, Plan]:
        """Plans by the map, and follows the plan until the next frame. Returns from where, where
        to, and the plan."""
        self._maps.append(deepcopy(believed))
        mission = self._stage.mission
        along_m = mission.along(self._motion.position_m)
        target_m = mission.at(np.array(min(along_m + self._rules.look_ahead_m, mission.length_m)))
        motion = self._motion
        plan = self._planned(motion, believed, target_m)
        self._halts += not plan.clear

        references = self._references(plan, target_m)
        wind = self._wind[self._flown_steps : self._flown_steps + self._steps]
        states = self._airframe.follow(self.state, references, wind)
        states = self._until_hit(states)
        self.state = states[-1]
        self._states.append(states)
        self._flown_steps += len(states)
        self._motion = Motion(*references[-1, :9].reshape(3, 3))
        self._yaw_rad = references[-1, 9]
        self._judge(mission.along(self.state[POSITION]))
        return motion, target_m, plan

    def _planned(self, motion: Motion, believed: BeliefMap, target_m: Vector) -> Plan:
        """Returns the planner's plan. One that keeps its stops goes on with the last plan where
        nothing new is admissible and the rest of that is: the promised stop comes at its end."""
        plan, rest = self._planner(motion, believed, target_m), None
        if self._plan is not None:
            rest = self._plan.after(1 / self._rules.plan_hz)
        if rest is not None and not plan.clear and getattr(self._planner, "keeps_stops", False):
            [price_m] = self._planner.prices([rest], motion, believed, target_m)
            plan = rest if math.isfinite(price_m) else plan
        self._plan = plan
        return plan

    def _references(self, plan: Plan, target_m: Vector) -> np.ndarray:
        """Returns the plan at every step, and the yaw, which turns to where the UAV goes."""
        motions = plan.at(np.arange(1, self._steps + 1) / STEP_HZ)
        ahead = plan.at(np.array([min(plan.duration_s, 1.0)]))[0, :3] - self._motion.position_m
        if math.hypot(ahead[0], ahead[1]) < 1.0:
            ahead = target_m - self._motion.position_m
        turn_rad = math.atan2(ahead[1], ahead[0]) - self._yaw_rad
        turn_rad = (turn_rad + math.pi) % (2 * math.pi) - math.pi
        reached = np.arange(1, self._steps + 1) * self._rules.yaw_rate_radps / STEP_HZ
        yaw_rad = self._yaw_rad + np.sign(turn_rad) * np.minimum(reached, abs(turn_rad))
        return np.column_stack([motions, yaw_rad])

    def _until_hit(self, states: States) -> States:
        """Returns the states up to the first touch of anything."""
        places_m = np.concatenate([self.state[None, POSITION], states[:, POSITION]])
        places_m = places_m[::STEPS_A_SCENE_STEP]
        step = self._flown_steps // STEPS_A_SCENE_STEP
        for k in range(len(places_m) - 1):
            steps = step + k, step + k + 1
            near = self._stage.obstacles.nearest(places_m[k], places_m[k + 1], steps)
            if near.distance_m < self._nearest.distance_m:
                self._nearest = near
            if near.distance_m < self._rules.radius_m:
                self.outcome = "collided"
                return states[: (k + 1) * STEPS_A_SCENE_STEP]
        return states

    def _judge(self, along_m: float) -> None:
        """Sets the outcome where the flight is over."""
        if self.outcome is not None:
            return
        mission, rules = self._stage.mission, self._rules
        if along_m > self._farthest_m + 0.5:
            self._farthest_m, self._farthest_s = along_m, self.time_s

        aside_m = np.linalg.norm(self.state[POSITION] - mission.at(np.array(along_m)))
        if along_m > mission.length_m - rules.arrived_m and aside_m < rules.aside_m:
            self.outcome = "arrived"
        elif self.time_s - self._farthest_s > rules.stuck_s:
            self.outcome = "stuck"
        # Beyond that far aside nobody knows what there is to be hit.
        elif self.time_s >= rules.late_s or aside_m > MARGIN_M.min():
            self.outcome = "late"

    def flown(self) -> Flown:
        """Returns the record of the flight."""
        believed = tuple(map(self._believed, (2.0, 1.0, 0.5)))
        states = np.concatenate(self._states)
        return Flown(str(self.outcome), states, self._nearest, believed, self._halts)

    def _believed(self, before_s: float) -> float:
        """Returns the probability of occupied that the map held, ``before_s`` earlier, at the
        place where the flight ended; for an actor, at its earlier place."""
        back = min(round(before_s * self._rules.plan_hz), len(self._maps) - 1)
        place_m = self.state[POSITION]
        for actor in self._stage.scene.actors:
            if actor.actor_id == self._nearest.actor_id:
                frame = math.ceil(self._flown_steps / self._steps) - 1 - back
                steps = [frame * self._steps, self._flown_steps]
                then_m, now_m = actor.position_m[[step // STEPS_A_SCENE_STEP for step in steps]]
                place_m = place_m + then_m - now_m
        return self._maps[-1 - back].probability_near(place_m, 1.0)
