"""The right of way over a hand-made junction of two roads, with traffic lights and without."""

from itertools import product

import numpy as np
import pytest

from src.sim.actor import HABITS
from src.sim.driver import DECISION_S, drive
from src.sim.junction import passages_of
from src.sim.layout import Gate
from src.sim.lights import AMBER_S, GREEN_S, PHASE_S, LightPlan
from src.sim.towns.polyline import turn
from tests.sim.roads import SIZES_M, overlapping, road_user, way

EAST, NORTH, WEST, SOUTH = range(4)
STRAIGHT, LEFT, RIGHT = 0, 1, 3
LINE_M, CLEAR_M = 48.0, 4.0
KERB_M, WALK_M = 5.0, 18.0


def rotated(points_m, quarters):
    for _ in range(quarters):
        points_m = [(-y_m, x_m) for x_m, y_m in points_m]
    return np.array(points_m, dtype=float)


def turns_of(arm):
    """Indices of the turns from the lane of an arm: straight on, left and right."""
    return 8 + 3 * arm, 9 + 3 * arm, 10 + 3 * arm


def junction(has_lights):
    """The lanes into it by their direction, those out of it, then all turns; and a crossing.

    People cross the road from the west, both ways.
    """
    phases = [(k % 2, 2) if has_lights else (None, 0) for k in range(4)]
    turns = []
    for arm, by in product(range(4), (STRAIGHT, LEFT, RIGHT)):
        start_m, end_m = rotated([(-8, -2)], arm)[0], rotated([(8, -2)], (arm + by) % 4)[0]
        corner_m = {STRAIGHT: (0, -2), LEFT: (2, -2), RIGHT: (-2, -2)}[by]
        points_m = turn(start_m, rotated([corner_m], arm)[0], end_m)
        turns.append(way(*points_m, successors=(4 + (arm + by) % 4,), speed_mps=6.0))

    lines = [Gate(0, LINE_M, CLEAR_M, False, *phases[k]) for k in range(4)]
    into = [
        way(*rotated([(-60, -2), (-8, -2)], k), successors=turns_of(k), gate=lines[k])
        for k in range(4)
    ]
    out_of = [way(*rotated([(8, -2), (180, -2)], k)) for k in range(4)]
    kerb = Gate(0, KERB_M, -KERB_M, True, *phases[EAST])
    ends_m = (-10, -9), (-10, 9)
    walks = [way(*points_m, speed_mps=2.5, gate=kerb) for points_m in (ends_m, ends_m[::-1])]
    return (*into, *out_of, *turns), tuple(walks)


OPEN, LIT = junction(has_lights=False), junction(has_lights=True)


def wheels(arm, by=STRAIGHT, start_m=10.0, speed_mps=9.0, name="car", paths=OPEN):
    onward = turns_of(arm)[(STRAIGHT, LEFT, RIGHT).index(by)]
    chain = [paths[0][k] for k in (arm, onward, 4 + (arm + by) % 4)]
    return road_user(name, chain, start_m, speed_mps)


def walker(start_m=1.0, back=False, speed_mps=1.4, paths=OPEN):
    # Everybody keeps to the right.
    return road_user("pedestrian", [paths[1][back]], start_m, speed_mps, left_m=-0.35)


def driven(actors, duration_s, plans=None):
    """The motion of actors that never overlap, and when the front of each one passes the line and
    its rear is over, in seconds (inf if never)."""
    motion = drive(actors, duration_s, plans)
    arcs_m = motion.arc_m
    boxes = [(*actor.route.at(arc_m), actor.size_m[:2]) for actor, arc_m in zip(actors, arcs_m.T)]
    assert not overlapping(boxes)

    half_m = np.array([actor.size_m[0] / 2 for actor in actors])
    passages = [passage for actor in actors for passage in passages_of(actor)]
    entered = arcs_m + half_m > [passage.start_m for passage in passages]
    left = arcs_m - half_m > [passage.end_m for passage in passages]
    return motion, first_s(entered), first_s(left)


def first_s(holds):
    """When each column holds for the first time; inf if never."""
    return np.where(holds.any(axis=0), holds.argmax(axis=0) * DECISION_S, np.inf)


def arcs_alone_m(actor, duration_s):
    return drive([actor], duration_s).arc_m[:, 0]


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("by", [(STRAIGHT, STRAIGHT), (LEFT, STRAIGHT), (STRAIGHT, LEFT)])
def test_who_comes_first_goes_first_and_the_other_waits_before_the_line(first, by):
    starts_m = (22.0, 12.0) if first == 0 else (12.0, 22.0)
    cars = [wheels(arm, by[k], starts_m[k]) for k, arm in enumerate((EAST, NORTH))]
    motion, entered_s, left_s = driven(cars, 25.0)
    assert entered_s[first] < left_s[first] <= entered_s[1 - first] < np.inf
    assert left_s.max() < 20
    # The first drives as though it were alone; the other does not.
    alone_m = [arcs_alone_m(car, 25.0) for car in cars]
    assert motion.arc_m[:, first] == pytest.approx(alone_m[first], abs=1e-6)
    assert (motion.arc_m[:, 1 - first] < alone_m[1 - first] - 5).any()


def test_ways_that_do_not_meet_are_used_at_the_same_time():
    four_rights = [(arm, RIGHT) for arm in (EAST, NORTH, WEST, SOUTH)]
    opposite, merging = [(EAST, STRAIGHT), (WEST, STRAIGHT)], [(EAST, RIGHT), (NORTH, STRAIGHT)]
    for ways in (opposite, merging, four_rights):
        cars = [wheels(arm, by, start_m=20.0) for arm, by in ways]
        motion, _, _ = driven(cars, 8.0)
        for k, car in enumerate(cars):
            assert motion.arc_m[:, k] == pytest.approx(arcs_alone_m(car, 8.0), abs=0.2)


@pytest.mark.parametrize("paths", [OPEN, LIT])
@pytest.mark.parametrize("seed", range(3))
def test_all_get_over_a_busy_junction_and_nobody_overlaps(paths, seed):
    rng = np.random.default_rng(seed)
    crowd = [walker(2.0, back, paths=paths) for back in (False, True)]
    for arm, start_m in product(range(4), (40.0, 24.0, 8.0)):
        by, name = rng.choice([STRAIGHT, LEFT, RIGHT]), rng.choice(["car", "bus", "motorcycle"])
        crowd.append(wheels(arm, by, start_m, rng.uniform(6, 10), name, paths))
    _, entered_s, left_s = driven(crowd, 110.0, {0: LightPlan(2, rng.uniform(0, 2 * PHASE_S))})
    assert left_s.max() < 100
    # Nobody passes anybody on an approach.
    assert (np.diff(entered_s[2:].reshape(4, 3)) > 0).all()


def test_people_and_cars_wait_for_each_other():
    # The walker is on the crossing before the car comes.
    _, entered_s, left_s = driven([wheels(EAST, start_m=8.0), walker(4.5)], 25.0)
    assert left_s[1] <= entered_s[0] < np.inf
    # The car is before the line first.
    motion, entered_s, left_s = driven([wheels(EAST, start_m=40.0), walker(3.0)], 25.0)
    assert left_s[0] <= entered_s[1] < np.inf
    waits = (motion.speed_mps[:, 1] < 0.01) & (motion.arc_m[:, 1] < WALK_M / 2)
    assert waits.sum() > 5
    assert motion.arc_m[waits, 1].max() + SIZES_M["pedestrian"][0] / 2 < KERB_M


def test_people_share_a_crossing():
    motion, _, _ = driven([walker(3.0), walker(3.0, back=True), walker(1.5)], 15.0)
    assert motion.speed_mps[:80].min() > 0.8


def test_nobody_enters_on_red_and_everybody_stops_before_the_line():
    """Two cars whose arms have green in turn, from many times of the cycle on."""
    waited = late = 0
    cars = [wheels(EAST, STRAIGHT, 5.0, 7.0, paths=LIT), wheels(NORTH, STRAIGHT, 5.0, paths=LIT)]
    for plan in (LightPlan(2, offset_s) for offset_s in np.arange(0, 2 * PHASE_S, 1.6)):
        motion, times_s, _ = driven(cars, 25.0, {0: plan})
        for k, entered_s in enumerate(times_s):
            assert entered_s < np.inf
            phase = passages_of(cars[k])[0].gate.phase
            assert plan.red_for_s(phase, entered_s) == 0
            front_m = motion.arc_m[:, k] + SIZES_M["car"][0] / 2
            stands = motion.speed_mps[:, k] < 0.01
            assert (front_m[stands] < LINE_M - 0.3).all()
            waited += stands.any()

            if not plan.is_green(phase, entered_s):
                # It is amber, and when that began the car could not have stopped any more.
                late += 1
                since_s = PHASE_S * phase - plan.offset_s + GREEN_S
                amber_s = since_s + 2 * PHASE_S * np.round((entered_s - since_s) / (2 * PHASE_S))
                assert 0 <= entered_s - amber_s < AMBER_S
                at = max(int(amber_s / DECISION_S), 0)
                braking_m = motion.speed_mps[at, k] ** 2 / (2 * HABITS["car"].brake_mps2)
                assert LINE_M - front_m[at] < braking_m + 1.5
    assert waited > 15
    assert late >= 1


def test_people_cross_on_red_for_the_cars_and_are_off_the_road_before_green():
    waited = 0
    for offset_s in np.arange(0, 2 * PHASE_S, 2.5):
        plan, one = LightPlan(2, offset_s), walker(3.0, paths=LIT)
        motion, (entered_s,), _ = driven([one], 2 * PHASE_S + 15, {0: plan})
        assert plan.red_for_s(0, entered_s) > 0
        waited += entered_s > 5
        # Who has waited must first get going, which may cost a second.
        on_road = (motion.arc_m[:, 0] > KERB_M) & (motion.arc_m[:, 0] < WALK_M - KERB_M)
        green = [plan.is_green(0, k * DECISION_S - 1.0) for k in range(len(on_road))]
        assert not (on_road & np.array(green)).any()
    assert waited > 5
