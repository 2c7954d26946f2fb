"""Actors on hand-made lanes: they keep their distance, stop in time and slow down for turns."""

import numpy as np
import pytest

from src.sim.actor import HABITS
from src.sim.driver import EMERGENCY_MPS2, drive
from tests.sim.roads import SIZES_M, road_user, way

LANE = way((-50, -2), (100, -2))


def line_up(*cars):
    return [road_user("car", [LANE], start_m, speed_mps) for start_m, speed_mps in cars]


def test_a_fast_car_settles_behind_a_slow_one():
    motion = drive(line_up((10, 9.0), (45, 0.5)), 14.0)
    gap_m = motion.arc_m[:, 1] - motion.arc_m[:, 0] - SIZES_M["car"][0]
    assert gap_m.min() > HABITS["car"].gap_m
    assert motion.speed_mps[0, 0] == pytest.approx(9.0)
    assert motion.speed_mps[-1, 0] == pytest.approx(0.5, abs=0.3)
    # It sees the difference of the speeds early enough to brake no harder than is comfortable.
    assert motion.acceleration_mps2[:, 0].min() > -HABITS["car"].brake_mps2


def test_cars_stop_at_the_end_of_their_way():
    motion = drive(line_up((100, 9.0)), 20.0)
    assert motion.speed_mps[-1, 0] < 0.1
    assert 140 < motion.arc_m[-1, 0] + SIZES_M["car"][0] / 2 < 150


def test_who_crosses_is_waited_for():
    crossing = way((50, -30), (50, 30), speed_mps=1.4)
    walker = road_user("pedestrian", [crossing], 28.0, 0.05)
    motion = drive([*line_up((70, 9.0)), walker], 8.0)
    assert motion.speed_mps[-1, 0] < 0.3
    assert motion.arc_m[-1, 0] + SIZES_M["car"][0] / 2 < 99.5
    # It does not brake for someone who is still on the pavement.
    aside = road_user("pedestrian", [crossing], 20.0, 0.05)
    passed = drive([*line_up((70, 9.0)), aside], 5.0)
    assert passed.arc_m[-1, 0] > 105


@pytest.mark.parametrize("name", SIZES_M)
def test_everyone_slows_down_for_a_turn_in_time(name):
    bend = way((0, 0), (60, 0), (60, 60), speed_mps=12.0)
    one = road_user(name, [bend], 15.0, 12.0)
    motion = drive([one], 12.0)
    sharpness = np.interp(motion.arc_m[:, 0], one.route.arc_m, one.route.sharpness())
    speed_mps, habits = motion.speed_mps[:, 0], HABITS[name]
    assert (speed_mps * sharpness).max() < 1.1 * habits.turn_radps
    assert (speed_mps**2 * sharpness).max() < 1.1 * habits.turn_mps2
    assert motion.acceleration_mps2.min() > -1.2 * habits.brake_mps2
    assert motion.acceleration_mps2.max() <= habits.accelerate_mps2


def test_people_who_meet_pass_each_other_but_no_one_walks_into_another():
    walk, back = way((0, 0), (40, 0)), way((40, 0), (0, 0))
    meeting = [road_user("pedestrian", [path], 15.0, 1.4, left_m=-0.35) for path in (walk, back)]
    passed = drive(meeting, 12.0)
    assert passed.arc_m[-1].min() > 30
    # In the middle of the walk neither has room to pass.
    head_on = [road_user("pedestrian", [path], 15.0, 1.4) for path in (walk, back)]
    stuck = drive(head_on, 12.0)
    assert 40 - stuck.arc_m[-1].sum() > SIZES_M["pedestrian"][0]
    assert stuck.speed_mps[-1].max() < 0.1


def test_who_is_suddenly_blocked_brakes_as_hard_as_one_can():
    """Somebody steps out of nowhere: a walker's way crosses the lane just before the car."""
    walker = road_user("pedestrian", [way((40, -20), (40, 20), speed_mps=3.0)], 14.0, 3.0)
    motion = drive([*line_up((72, 9.0)), walker], 4.0)
    assert -EMERGENCY_MPS2 <= motion.acceleration_mps2[:, 0].min() < -HABITS["car"].brake_mps2
    assert motion.speed_mps.min() >= 0
    assert np.diff(motion.arc_m, axis=0).min() >= -1e-9
