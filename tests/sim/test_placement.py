"""Where actors start: in the camera's view, with room around them, never on a junction."""

import numpy as np
import pytest

from src.sim.layout import Gate, Town
from src.sim.pilot import STEP_S
from src.sim.placement import SHOULDER_M, START_GAP_M, Placer
from tests.sim.roads import SIZES_M, overlapping, way

CAR_M, PERSON_M = SIZES_M["car"], SIZES_M["pedestrian"]
REACH_M = 45.0
LINE_M, CLEAR_M = 56.0, 4.0
# Eastward over a junction or to the right at it; westward there is nothing to wait for.
LANES = (
    way((-60, -2), (0, -2), successors=(1, 2), gate=Gate(0, LINE_M, CLEAR_M, False, None, 0)),
    way((0, -2), (16, -2), successors=(3,)),
    way((0, -2), (4, -4), (6, -8), successors=(4,)),
    way((16, -2), (120, -2)),
    way((6, -8), (6, -70)),
    way((120, 2), (-60, 2)),
)
WALKS = (
    way((-60, -8), (-5, -8), successors=(1,), half_width_m=0.4),
    way((-5, -8), (-5, 8), gate=Gate(0, 3.0, -3.0, True, None, 0), half_width_m=0.4),
)
TOWN = Town("hand-made", lambda x, y: 0 * x, (), (), LANES, WALKS, ())


def flight(x_mps=5.0, y_mps=0.0, start_m=(0.0, 0.0)):
    time_s = np.arange(round(10 / STEP_S) + 1) * STEP_S
    return np.c_[start_m[0] + x_mps * time_s, start_m[1] + y_mps * time_s, 9 + 0 * time_s]


def starts_on(one, paths):
    return any(one.route.paths[0] is path for path in paths)


EASTWARD_M = flight(start_m=(-50.0, 0.0))


def filled(name, seed=0, uav_m=EASTWARD_M):
    """As many of a kind as a flight, eastward over the junction, finds room for."""
    placer, placed = Placer(TOWN, np.random.default_rng(seed), uav_m, 90.0, REACH_M), []
    while (one := placer.place(name, SIZES_M[name], placed)) is not None:
        placed.append(one)
        assert len(placed) < 200
    return placed


@pytest.mark.parametrize("name", ["car", "bus", "motorcycle"])
def test_nobody_starts_on_a_junction(name):
    flights = [EASTWARD_M, flight(start_m=(-10.0, 0.0))]
    placed = [one for uav_m in flights for one in filled(name, uav_m=uav_m)]
    assert len(placed) > 12

    # The lanes on which they start; the turns, 1 and 2, are the junction itself.
    first = [[lane is one.route.paths[0] for lane in LANES].index(True) for one in placed]
    assert {0, 3, 5} <= set(first) <= {0, 3, 4, 5}

    for k, one in zip(first, placed):
        (x_m, y_m), _ = one.start
        half_m = SIZES_M[name][0] / 2
        # How far it stands from the line before the junction, and from the junction behind it.
        free_m = {0: LINE_M - 60 - x_m, 3: x_m - 16 - CLEAR_M, 4: -8 - CLEAR_M - y_m}
        assert free_m.get(k, np.inf) >= half_m - 0.1
        assert half_m < one.start_m < one.route.length_m - half_m - 1


def test_nobody_starts_on_a_crossing():
    placed = [one for seed in range(3) for one in filled("pedestrian", seed)]
    assert len(placed) > 20
    along_m = [one.start[0][1] for one in placed if one.route.paths[0] is WALKS[1]]
    assert (np.abs(along_m) >= 5).all()


def test_nobody_starts_where_nothing_is_seen():
    for seed in range(3):
        # It flies faster than anybody drives, so what is behind it stays there.
        ahead = filled("car", seed, flight(12.0, start_m=(-20.0, 0.0)))
        assert len(ahead) > 5
        assert min(one.start[0][0] for one in ahead) > -20 - 1
    assert filled("car", uav_m=flight(0.0, 9.0, start_m=(30.0, 20.0))) == []
    assert filled("car", uav_m=flight(0.0, -9.0, start_m=(30.0, 20.0)))


def test_they_start_with_room_around_them_until_there_is_none():
    room_m = (CAR_M[0] + 2 * START_GAP_M, CAR_M[1])
    rooms = [(*one.start, room_m) for one in filled("car")]
    assert 8 < len(rooms) < 40
    assert not overlapping(rooms)


def test_cars_take_lanes_and_people_walks_as_wide_as_they_may():
    for one in filled("car"):
        assert starts_on(one, LANES)
        assert abs(abs(one.start[0][1]) - 2) < 0.2 or abs(one.start[0][0] - 6) < 0.2
    for one in filled("pedestrian"):
        assert starts_on(one, WALKS)
        (x_m, y_m), yaw_rad = one.start
        if abs(yaw_rad) < 0.01 and x_m < -15:
            # To the right of the middle, but with no more of it beyond the edge than towns keep.
            assert -8 - 0.4 - SHOULDER_M - 1e-6 <= y_m - PERSON_M[1] / 2 < -8 - 0.4
    lefts = [one.start[0][1] for one in filled("motorcycle") if one.start[1] == 0]
    assert max(lefts) < -2.2
    # Of those who ride bicycles, some are on walks.
    bicycles = [one for seed in range(3) for one in filled("bicycle", seed)]
    assert 0 < sum(starts_on(one, WALKS) for one in bicycles) < len(bicycles)
