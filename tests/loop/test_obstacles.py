"""Distances to triangles are exact, and nothing is flown through, at any speed."""

import numpy as np
import pytest

from src.loop.obstacles import REACH_M, Obstacles, _apart
from src.ontology import CAR, THIN_STRUCTURE
from src.sim.assets import upright
from src.sim.scene import Scene, parts_of
from src.sim.solid import Solid
from tests.loop.yard import box_actor

LOWER_M, UPPER_M = np.full(3, -10.0), np.full(3, 10.0)
WIRE = Solid("box", THIN_STRUCTURE, (0.03, 20.0, 0.03), upright(0.0, 0.0, 5.0), "metal")


def sampled(triangle, start, end, side=60):
    """The distance between points spread over both."""
    share = np.linspace(0, 1, side)
    u, v = np.meshgrid(share, share)
    inside = u + v <= 1
    face = triangle[0] + u[inside, None] * (triangle[1] - triangle[0])
    face = face + v[inside, None] * (triangle[2] - triangle[0])
    way = start + share[:, None] * (end - start)
    return np.linalg.norm(way[:, None] - face, axis=-1).min()


def test_distances_are_those_of_densely_sampled_points():
    rng = np.random.default_rng(0)
    for _ in range(60):
        triangle, start, end = rng.normal(size=(3, 3)), *rng.normal(size=(2, 3))
        exact = _apart(triangle, start, end, np.inf)
        assert exact <= sampled(triangle, start, end) + 1e-9
        assert exact == pytest.approx(sampled(triangle, start, end), abs=0.06)
        assert _apart(triangle, start, 2 * triangle.mean(axis=0) - start, np.inf) == 0, "through it"


@pytest.mark.parametrize("speed_mps", [1.0, 6.0, 20.0])
@pytest.mark.parametrize(("beyond_m", "hits"), [(-0.01, True), (0.01, False)])
def test_a_wire_of_3_cm_is_hit_and_one_a_centimetre_beyond_the_body_is_not(
    speed_mps, beyond_m, hits
):
    """The body flies under the wire in steps of a fiftieth of a second."""
    radius_m = 0.3
    obstacles = Obstacles(Scene(parts_of([WIRE]), ()), LOWER_M, UPPER_M)
    height_m = 5.0 - 0.015 - radius_m - beyond_m
    x_m = np.arange(-8.0, 8.0, speed_mps / 50) + 0.123
    places_m = np.stack([x_m, 0 * x_m + 0.37, 0 * x_m + height_m], axis=1)
    found = [obstacles.nearest(*places_m[k : k + 2], (0, 0)) for k in range(len(x_m) - 1)]
    nearest = min(found)
    assert (nearest.distance_m < radius_m) == hits
    assert nearest.distance_m == pytest.approx(radius_m + beyond_m, abs=1e-9)
    assert (nearest.class_id, nearest.actor_id) == (THIN_STRUCTURE, 0)
    assert obstacles.nearest(np.zeros(3), np.array([1.0, 0, 0]), (0, 0)) == (REACH_M, 255, 0)


def test_an_actor_is_met_on_its_way_from_step_to_step():
    """Between two steps it passes the whole of a UAV that stands: each end alone is 2 m away."""
    plate = box_actor(CAR, (0.02, 2.0, 2.0), [[-2.5, 0.0, 0.0], [2.5, 0.0, 0.0]], 1.0)
    obstacles = Obstacles(Scene((), (plate,)), LOWER_M, UPPER_M)
    here_m = np.array([0.0, 0.0, 1.0])
    assert obstacles.nearest(here_m, here_m, (0, 1)) == (0.0, CAR, 1)
    assert obstacles.nearest(here_m, here_m, (0, 0)).distance_m == REACH_M
