"""What a belief costs the planner, by flights in the yard whose answers are known."""

import math

import numpy as np
import pytest

from src.loop.airframe import Airframe
from src.loop.flight import fly
from src.loop.perception import Constant
from src.loop.planner import Motion, QuinticPlanner
from src.loop.twin import MOST_M, Twin
from tests.loop.test_closed_loop import GRID, RULES, blind, seeing, stage_at


def costs(perception, camera, height_m=4.0):
    stage, planner = stage_at(height_m), QuinticPlanner()
    twin, moments = Twin(GRID, planner, RULES, stage.truth), []
    fly(stage, perception, planner, Airframe(), camera, RULES, [twin, moments.append])
    row = twin.row()
    assert row["plans"] == len(moments)
    return row


def test_the_truth_regrets_nothing(camera):
    row = costs(seeing(in_sight=False), camera)
    assert (row["regret_m"], row["unsafe_plans"], row["phantom_stops"]) == (0.0, 0, 0)


def test_who_sees_nothing_plans_into_the_wall(camera):
    row = costs(blind(), camera)
    assert row["unsafe_plans"] >= 3
    assert row["regret_m"] >= MOST_M * row["unsafe_plans"] / row["plans"] - 1e-3
    assert row["phantom_stops"] == 0


def test_who_is_afraid_of_everything_stops_once_for_nothing(camera):
    """From the start to the end it stands: one episode."""
    row = costs(Constant("all_occupied", GRID, 1.0), camera)
    assert (row["phantom_stops"], row["unsafe_plans"]) == (1, 0)
    assert row["regret_m"] > 1.0


class Startled(Constant):
    """Sees nothing, and once something everywhere."""

    def __call__(self, frame):
        belief = super().__call__(frame)
        belief.occupied[:] = 2.0 < frame.time_s < 2.5
        return belief


def test_an_emergency_stop_for_nothing_is_dear_and_not_unsafe(camera):
    """It may brake harder than other plans may."""
    stage, planner, halts = stage_at(4.0, y_m=-20.0), QuinticPlanner(), []
    twin = Twin(GRID, planner, RULES, stage.truth)
    watches = [twin, lambda moment: halts.append(not moment.plan.clear)]
    fly(stage, Startled("startled", GRID, 0.0), planner, Airframe(), camera, RULES, watches)
    assert any(halts)
    assert twin.row()["unsafe_plans"] == 0
    assert 0 < sum(twin._regrets_m) < MOST_M * sum(halts)


@pytest.mark.parametrize("speed_mps", [0.0, 3.0, 6.0])
def test_the_price_of_the_plan_taken_is_the_least(camera, speed_mps):
    """By the same map no other plan is cheaper, and one through the wall has no price."""
    stage, planner = stage_at(4.0), QuinticPlanner()
    twin = Twin(GRID, planner, RULES, stage.truth)
    moments = []
    fly(stage, seeing(), planner, Airframe(), camera, RULES, [twin, moments.append])
    moment = min(moments, key=lambda each: abs(each.motion.position_m[0] - 22.0))
    velocity_mps = np.array([speed_mps, 0.0, 0.0])
    motion = Motion(moment.motion.position_m, velocity_mps, np.zeros(3))

    for other in moments:
        twin(other)
        if other is moment:
            break
    belief, target_m = twin._map, moment.target_m
    plan = planner(motion, belief, target_m)
    (least_m,) = planner.prices([plan], motion, belief, target_m)
    assert plan.clear
    assert math.isfinite(least_m)
    for bearing_deg in (-60.0, -20.0, 0.0, 20.0, 60.0):
        one = QuinticPlanner(
            bearings_deg=(bearing_deg,),
            elevations_deg=(0.0,),
            end_speeds=(1.0,),
            durations_s=(1.6,),
        )
        other = one(motion, belief, target_m)
        assert planner.prices([other], motion, belief, target_m)[0] >= least_m - 1e-6
