"""Plans are smooth, keep away from what is believed, and can always end."""

import numpy as np
import pytest

from src.errors import UserError
from src.loop.belief import BeliefMap
from src.loop.planner import Motion, QuinticPlanner

HERE_M, TARGET_M = np.array([10.0, 0.0, 4.0]), np.array([25.0, 0.0, 4.0])
AT_CRUISE = Motion(HERE_M, np.array([6.0, 0.0, 0.0]), np.zeros(3))
AT_REST = Motion(HERE_M, np.zeros(3), np.zeros(3))
NEED_M = 0.3 + 0.1 + 0.5 * np.sqrt(3) / 2


def known_map(occupied=lambda x, y, z: x < -1e9, seen=True):
    """A map around the UAV that holds what a function of places says."""
    belief = BeliefMap((80, 80, 32), 0.5, 0.5)
    belief.first = np.round(HERE_M / 0.5).astype(int) - np.array([40, 40, 16])
    center_m = (np.indices(belief.log_odds.shape).T + 0.5) * 0.5 + belief.lower_m
    belief.seen[:] = seen
    belief.log_odds[:] = np.where(occupied(*center_m.T), 3.0, -2.0)
    return belief


def wall(x, y, z):
    return (np.abs(x - 19) < 0.5) & (np.abs(y - 1) < 3)


def samples(plan, seconds=None):
    seconds = plan.duration_s if seconds is None else seconds
    return plan.at(np.linspace(0, seconds, 200))


def test_a_plan_begins_with_the_motion_and_its_parts_are_each_others_slopes():
    motion = Motion(HERE_M, np.array([4.0, 1.0, -0.5]), np.array([0.5, -1.0, 0.2]))
    plan = QuinticPlanner()(motion, known_map(), TARGET_M)
    assert np.allclose(plan.at(np.zeros(1))[0], np.concatenate(motion))
    times_s = np.linspace(0, plan.duration_s, 2001)
    place, speed, push = np.split(plan.at(times_s), 3, axis=1)
    assert np.abs(np.gradient(place, times_s, axis=0)[1:-1] - speed[1:-1]).max() < 1e-4
    assert np.abs(np.gradient(speed, times_s, axis=0)[1:-1] - push[1:-1]).max() < 1e-3
    assert np.allclose(push[-1], 0, atol=1e-9)


def test_in_the_open_it_goes_straight_on_as_fast_as_it_likes():
    plan = QuinticPlanner()(AT_CRUISE, known_map(), TARGET_M)
    assert plan.clear
    assert not plan.stops
    assert np.abs(samples(plan)[:, 1:3] - HERE_M[1:]).max() < 0.05
    assert np.linalg.norm(samples(plan)[-1, 3:6]) == pytest.approx(6.0)


@pytest.mark.parametrize("motion", [AT_CRUISE, AT_REST])
def test_it_goes_around_a_wall_at_its_distance_and_within_its_limits(motion):
    belief, planner = known_map(wall), QuinticPlanner()
    centers_m = np.argwhere(belief.occupied(0.5)) * 0.5 + 0.25 + belief.lower_m
    for _ in range(25):
        plan = planner(motion, belief, TARGET_M)
        assert plan.clear
        apart_m = np.linalg.norm(samples(plan)[:, None, :3] - centers_m, axis=-1).min()
        assert apart_m > NEED_M - 0.1
        assert np.linalg.norm(samples(plan)[:, 3:6], axis=1).max() < 1.2 * 6
        assert np.linalg.norm(samples(plan)[:, 6:], axis=1).max() < 6.1
        motion = Motion(*plan.at(np.array([0.2]))[0].reshape(3, 3))
        if motion.position_m[0] > 21:
            break
    assert motion.position_m[0] > 21
    assert abs(motion.position_m[1]) < 5


def test_it_stops_before_what_it_cannot_pass():
    motion, belief = AT_CRUISE, known_map(lambda x, y, z: np.abs(x - 16) < 0.5)
    for _ in range(40):
        plan = QuinticPlanner()(motion, belief, TARGET_M)
        motion = Motion(*plan.at(np.array([0.2]))[0].reshape(3, 3))
        assert motion.position_m[0] < 15.5 - 0.3


def test_with_everything_occupied_it_stops_where_it_can():
    plan = QuinticPlanner()(AT_CRUISE, known_map(lambda x, y, z: x > -1e9), TARGET_M)
    assert plan.stops
    assert not plan.clear
    assert np.linalg.norm(plan.at(np.array([plan.duration_s]))[0, 3:]) < 1e-6


def test_the_unknown_is_free_costly_or_occupied():
    half_seen = known_map()
    half_seen.seen[:, 40:] = False  # what lies to the left
    target_m = np.array([25.0, 6.0, 4.0])
    left_m = {}
    for unknown in ("free", "costly", "occupied"):
        plan = QuinticPlanner(unknown=unknown, unknown_price=20.0)(AT_CRUISE, half_seen, target_m)
        left_m[unknown] = samples(plan)[:, 1].max()
    assert left_m["free"] > 1.0
    assert left_m["costly"] < left_m["free"]
    assert left_m["occupied"] < 0.1


def test_the_threshold_says_what_counts_as_occupied():
    belief = known_map(wall)
    belief.log_odds[belief.log_odds > 0] = 0.5  # a probability of 0.62
    brave, careful = (QuinticPlanner(threshold=t)(AT_CRUISE, belief, TARGET_M) for t in (0.7, 0.5))
    assert samples(brave)[-1, 0] > 20
    assert samples(careful)[-1, 0] < samples(brave)[-1, 0]


@pytest.mark.parametrize(
    "setting",
    [
        *({"threshold": 1.0}, {"unknown": "maybe"}, {"cruise_mps": 0.0}, {"margin_m": -1.0}),
        *({"margin_m": -1}, {"brake_mps2": 0.0}, {"durations_s": (0.0, 1.0)}),
    ],
)
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(UserError, match=next(iter(setting))):
        QuinticPlanner(**setting)


# ------------------------------------------------------------------------ stops, known and kept


def seen_until(x_m):
    belief = known_map()
    centers_m = (np.arange(80) + 0.5) * 0.5 + belief.lower_m[0]
    belief.seen[centers_m > x_m] = False
    return belief


@pytest.mark.parametrize("edge_m", [17.0, 19.5, 22.0])
def test_it_is_as_fast_as_it_can_stop_in_space_that_it_has_seen(edge_m):
    belief, motion = seen_until(edge_m), AT_CRUISE
    planner = QuinticPlanner(stops_in_known=True, keeps_stops=True)
    careless = QuinticPlanner(keeps_stops=True)
    for _ in range(40):
        plan = planner(motion, belief, TARGET_M)
        motion = Motion(*plan.at(np.array([0.2]))[0].reshape(3, 3))
        # Within the cell in which the last one that was seen ends.
        assert motion.position_m[0] < edge_m + 0.25
    assert motion.position_m[0] > edge_m - 2.5

    motion = AT_CRUISE
    for _ in range(15):
        plan = careless(motion, belief, TARGET_M)
        motion = Motion(*plan.at(np.array([0.2]))[0].reshape(3, 3))
    assert motion.position_m[0] > edge_m + 1


def test_where_all_is_seen_it_flies_as_ever():
    plans = [
        QuinticPlanner(stops_in_known=known)(AT_CRUISE, known_map(wall), TARGET_M)
        for known in (False, True)
    ]
    assert (plans[0].coefficients == plans[1].coefficients).all()


def test_the_rest_of_a_plan_is_the_same_way():
    plan = QuinticPlanner()(AT_CRUISE, known_map(wall), TARGET_M)
    rest = plan.after(0.2)
    times_s = np.linspace(0, rest.duration_s, 20)
    assert rest.duration_s == pytest.approx(plan.duration_s - 0.2)
    assert np.allclose(rest.at(times_s), plan.at(times_s + 0.2))
    assert plan.after(plan.duration_s - 0.05) is None


@pytest.mark.parametrize("keeps", [False, True])
def test_a_stop_takes_no_longer_than_was_planned_for(keeps):
    """Where nothing is admissible any more, a stop that is kept is the hardest one."""
    planner = QuinticPlanner(keeps_stops=keeps)
    crowded = known_map(lambda x, y, z: (x > 12.5) & (np.abs(y) > 0.6))
    stop = planner(AT_CRUISE, crowded, TARGET_M)
    assert (stop.stops, stop.clear) == (True, False)
    way_m = np.linalg.norm(samples(stop)[-1, :3] - HERE_M)
    hardest_m = 1.3 * 36 / (2 * planner.brake_mps2)
    assert (way_m == pytest.approx(hardest_m)) == keeps
    assert way_m >= hardest_m - 1e-6
