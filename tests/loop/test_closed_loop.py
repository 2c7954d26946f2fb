"""Whole flights in a yard with a wall and a wire: what comes of them, and of what they believe."""

import math
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from omegaconf import OmegaConf

from src.data.rates import STEP_HZ as SCENE_HZ
from src.geometry import VoxelGrid
from src.loop.airframe import POSITION, Airframe
from src.loop.camera import FlightCamera
from src.loop.flight import Rules, fly
from src.loop.mission import Mission
from src.loop.outcome import row_of
from src.loop.perception import Constant, Truth
from src.loop.planner import Motion, QuinticPlanner
from src.loop.stage import Stage
from src.loop.twin import MOST_M, Twin
from src.ontology import CAR
from src.sim.scene import Scene
from src.sim.traffic import TrafficConfig
from tests.loop.yard import WALL_X_M, WIRE_X_M, box_actor
from tests.synthetic import compose_config

GRID = VoxelGrid((0.0, -12.5, -10.0), (25.0, 12.5, 5.0), (50, 50, 30))
RULES = Rules()
PERCEPTIONS = {
    "blind": partial(Constant, occupied=0.0),
    "afraid": partial(Constant, occupied=1.0),
    "seen": partial(Truth, in_sight=True),
    "truth": partial(Truth, in_sight=False),
}


@cache
def camera():
    return FlightCamera(OmegaConf.to_container(compose_config("scale=tiny").sim, resolve=True))


def stage_at(height_m, y_m=0.0, draws=False):
    mission = Mission("tests.loop.yard", 0, 3, "clear", 0.0, y_m, 0.0, 60.0, height_m)
    return Stage.of(mission, TrafficConfig(uav_gap_m=0.0), 6.0, RULES.late_s + 1, draws)


def flown(stage, perception, planner=None):
    """A flight, with its row, its moments and the twin that watched it."""
    planner = planner or QuinticPlanner()
    twin, moments = Twin(GRID, planner, RULES, stage.truth), []
    watches = [twin, moments.append]
    result = fly(stage, perception, planner, Airframe(), camera(), RULES, watches)
    row = row_of(stage, result, 0.5) | twin.row()
    assert row["plans"] == len(moments)
    of_flight = {"moments": moments, "twin": twin, "stage": stage}
    return SimpleNamespace(**vars(result) | row | of_flight)


@cache
def flight(name, height_m=4.0, y_m=0.0):
    return flown(stage_at(height_m, y_m), PERCEPTIONS[name](name, GRID))


@pytest.mark.parametrize(
    ("height_m", "y_m", "x_m", "hit"),
    [(4.0, 0.0, WALL_X_M, "building"), (6.0, 6.0, WIRE_X_M, "thin_structure")],
)
def test_who_sees_nothing_hits_what_is_in_the_way_and_plans_into_it(height_m, y_m, x_m, hit):
    """At 6 m beside the wall there is the wire alone."""
    blind = flight("blind", height_m, y_m)
    assert blind.stage.blind_hits(6.0, RULES.radius_m)
    assert (blind.outcome, blind.hit, blind.fault) == ("collided", hit, "missed")
    assert blind.states[-1, 0] == pytest.approx(x_m, abs=0.9)
    assert blind.clearance_m < RULES.radius_m
    assert (blind.unsafe_plans >= 3, blind.phantom_stops) == (True, 0)
    assert blind.regret_m >= MOST_M * blind.unsafe_plans / blind.plans - 1e-3


@pytest.mark.parametrize("name", ["seen", "truth"])
@pytest.mark.parametrize("height_m", [4.0, 6.0])
def test_who_sees_arrives_and_the_truth_regrets_nothing(height_m, name):
    seeing = flight(name, height_m)
    assert (seeing.outcome, seeing.hit, seeing.fault) == ("arrived", "", "")
    assert seeing.clearance_m > 0.5
    assert 58 < seeing.path_m < 75
    if name == "truth":
        assert (seeing.regret_m, seeing.unsafe_plans, seeing.phantom_stops) == (0.0, 0, 0)


def test_who_is_afraid_of_everything_is_stuck_in_one_phantom_stop():
    afraid = flight("afraid")
    assert afraid.outcome == "stuck"
    assert afraid.time_s == pytest.approx(RULES.stuck_s, abs=0.3)
    assert afraid.path_m < 1.0
    assert (afraid.phantom_stops, afraid.unsafe_plans, afraid.regret_m > 1.0) == (1, 0, True)


def test_a_flight_is_the_same_bit_for_bit_whatever_flew_before():
    first = flight("seen")
    flight("blind")
    again = flown(stage_at(4.0), PERCEPTIONS["seen"]("seen", GRID))
    assert first.states.tobytes() == again.states.tobytes()
    assert first.nearest == again.nearest


def test_who_flies_far_off_its_way_is_late():
    """Nobody knows what there is to be hit."""

    class Astray(QuinticPlanner):
        def __call__(self, motion, belief, target_m):
            return super().__call__(motion, belief, motion.position_m + np.array([0.0, 15.0, 0.0]))

    stage, blind = stage_at(4.0), PERCEPTIONS["blind"]("blind", GRID)
    result = fly(stage, blind, Astray(), Airframe(), camera(), RULES)
    assert (result.outcome, result.time_s < RULES.stuck_s) == ("late", True)
    assert 15.0 < result.states[-1, 1] < 17.0


def test_a_picture_changes_nothing_of_the_truth():
    """The shed is in a corner of what is known of the scene."""
    points = [stage_at(4.0, draws=draws).truth.static[0] for draws in (False, True)]
    assert points[0].tobytes() == points[1].tobytes()
    assert ((points[0][:, 0] < -40.0) & (points[0][:, 1] < -40.0)).any()


def test_the_wind_is_the_missions():
    one = flight("blind", 4.0, -20.0)
    other = Mission(**{**vars(one.stage.mission), "index": 4})
    other = flown(Stage(other, one.stage.scene, one.stage.seconds), PERCEPTIONS["blind"]("b", GRID))
    assert np.abs(one.states[:400, POSITION] - other.states[:400, POSITION]).max() > 0.01


def test_a_perception_that_forgets_what_it_had_seen_planned_into_it():
    """What the map had called occupied 0.5 to 2 s before is not missed."""

    class Forgetful(Truth):
        def __call__(self, frame):
            belief = super().__call__(frame)
            if frame.world_from_body[0, 3] > WALL_X_M - 9:
                belief.occupied[:] = 0.0
            return belief

    told = flown(stage_at(4.0), Forgetful("forgetful", GRID, False))
    assert (told.outcome, told.fault) == ("collided", "planned_into")
    assert told.believed_2s > 0.5


def test_what_drives_into_a_uav_that_saw_it_coming_was_planned_into():
    """The place where they meet was free a second before; the car was seen at its own, but the
    planner wants to be surer."""
    steps = np.arange(round((RULES.late_s + 1) * SCENE_HZ) + 1)
    position_m = np.c_[90.0 - 8.0 * steps / SCENE_HZ, 0.0 * steps - 20.0, 0.0 * steps]
    car = box_actor(CAR, (1.0, 24.0, 20.0), position_m, 5.0, (-8.0, 0.0, 0.0))
    stage = stage_at(4.0, y_m=-20.0)
    stage = Stage(stage.mission, Scene(stage.scene.static, (car,)), stage.seconds)
    told = flown(stage, PERCEPTIONS["truth"]("truth", GRID), QuinticPlanner(threshold=0.97))
    assert (told.outcome, told.hit, told.fault) == ("collided", "car", "planned_into")
    assert told.believed_1s > 0.5


def test_an_emergency_stop_for_nothing_is_dear_and_not_unsafe():
    """It may brake harder than other plans may."""

    class Startled(Constant):
        def __call__(self, frame):
            belief = super().__call__(frame)
            belief.occupied[:] = 2.0 < frame.time_s < 2.5
            return belief

    told = flown(stage_at(4.0, y_m=-20.0), Startled("startled", GRID, 0.0))
    halts = sum(not moment.plan.clear for moment in told.moments)
    assert (halts > 0, told.unsafe_plans) == (True, 0)
    assert 0 < sum(told.twin._regrets_m) < MOST_M * halts


def test_the_price_of_the_plan_taken_is_the_least():
    """By the same map no other plan is cheaper, and one through the wall has no price."""
    seen, planner = flight("seen"), QuinticPlanner()
    moment = min(seen.moments, key=lambda each: abs(each.motion.position_m[0] - 22.0))
    twin = Twin(GRID, planner, RULES, seen.stage.truth)
    for other in seen.moments[: seen.moments.index(moment) + 1]:
        twin(other)

    for speed_mps in (0.0, 3.0, 6.0):
        velocity_mps = np.array([speed_mps, 0.0, 0.0])
        state = Motion(moment.motion.position_m, velocity_mps, np.zeros(3)), twin._map
        plan = planner(*state, moment.target_m)
        (least_m,) = planner.prices([plan], *state, moment.target_m)
        assert plan.clear
        assert math.isfinite(least_m)
        one = {"elevations_deg": (0.0,), "end_speeds": (1.0,), "durations_s": (1.6,)}
        for bearing_deg in (-60.0, -20.0, 0.0, 20.0, 60.0):
            other = QuinticPlanner(bearings_deg=(bearing_deg,), **one)(*state, moment.target_m)
            assert planner.prices([other], *state, moment.target_m)[0] >= least_m - 1e-6
