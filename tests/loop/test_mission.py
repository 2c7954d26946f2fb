"""Routes lie beside the corridors, begin and end in the open, and come from the seed alone."""

import numpy as np
import pytest

from src.errors import UserError
from src.loop.mission import Mission, VergeMissions, in_the_open
from src.sim.staging import place_of

TOWN = "tests.loop.yard"
SETTINGS = {
    **{"towns": [TOWN], "weathers": ["clear"], "maps": 2, "conflict": 3, "clear": 1, "tries": 12},
    **{"first_seed": 5, "length_m": 30.0, "offset_m": (0.5, 6.0), "height_m": (2.5, 4.0)},
}


def test_routes_are_parallel_to_a_corridor_beyond_its_edge_and_of_their_seed_alone():
    missions = VergeMissions(**SETTINGS)
    assert missions.places() == [(TOWN, 5), (TOWN, 6)]
    routes = list(missions.drawn(TOWN, 5))
    assert list(missions.drawn(TOWN, 6)) != routes == list(missions.drawn(TOWN, 5))
    assert len(routes) > 6
    for route in routes:
        assert abs(np.sin(route.yaw_rad)) < 1e-9
        assert 3.5 <= abs(route.y_m + 9.0) <= 9.0
        assert 2.5 <= route.height_m <= 4.0
        assert np.ptp(route.at(np.array([0.0, 30.0]))[:, 0]) == pytest.approx(30.0)
    assert {route.y_m > -9 for route in routes} == {True, False}


@pytest.mark.parametrize(
    ("x_m", "y_m", "open_"), [(0.0, 0.0, True), (-30.0, 0.0, False), (0.0, 30.0, True)]
)
def test_a_way_that_ends_in_a_wall_is_not_in_the_open(x_m, y_m, open_):
    """The wall stands at 30 m: a way of 60 m from -30 m ends in it."""
    mission = Mission(TOWN, 0, 0, "clear", x_m, y_m, 0.0, 60.0, 4.0)
    assert in_the_open(mission, place_of(TOWN, 0)) == open_


def test_along_is_how_far_one_came_and_never_beyond_the_ends():
    mission = Mission(TOWN, 0, 0, "clear", 1.0, 2.0, np.pi / 2, 60.0, 4.0)
    places = {(1.0, 12.0): 10.0, (7.0, 12.0): 10.0, (1.0, -5.0): 0.0, (1.0, 99.0): 60.0}
    for (x_m, y_m), along_m in places.items():
        assert mission.along(np.array([x_m, y_m, 4.0])) == pytest.approx(along_m)


@pytest.mark.parametrize(
    "setting",
    [{"towns": []}, {"maps": 0}, {"conflict": 0, "clear": 0}, {"tries": 0}],
)
def test_settings_that_leave_no_flight_are_refused(setting):
    with pytest.raises(UserError, match=f"mission.{next(iter(setting))}"):
        VergeMissions(**{**SETTINGS, **setting})
