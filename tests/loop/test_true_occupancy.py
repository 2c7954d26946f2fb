"""The truth is in the voxels that surfaces pass, where actors are now, as far as one sees."""

import numpy as np
import pytest

from src.geometry import VoxelGrid
from src.loop.true_occupancy import SPACING_M, TrueOccupancy, points_on
from src.ontology import BUILDING, CAR, FREE
from src.sim.assets import upright
from src.sim.scene import Scene, parts_of
from src.sim.solid import Solid
from tests.loop.yard import box_actor

GRID = VoxelGrid((0.0, -5.0, -5.0), (10.0, 5.0, 5.0), (20, 20, 20))
CORNERS = np.full(3, -20.0), np.full(3, 20.0)
WALL = Solid("box", BUILDING, (0.02, 4.0, 4.0), upright(6.2, 0.0, 0.0), "concrete")


def test_points_on_a_triangle_leave_no_gap_and_lie_on_it():
    triangles = np.array(
        [[[0.0, 0, 0], [3, 0, 0], [0, 2, 0]], [[0.0, 0, 1], [9, 0, 1], [9, 0.03, 1]]]
    )
    points, face = points_on(triangles)
    assert (points[face == 0, 2] == 0).all()
    assert (points[face == 1, 2] == 1).all()
    rng = np.random.default_rng(0)
    u, v = np.sort(rng.random((2, 500)), axis=0)
    anywhere = np.c_[3 * u, 2 * (1 - v), 0 * u]
    apart = np.linalg.norm(anywhere[:, None] - points[face == 0], axis=-1).min(axis=1)
    assert apart.max() < SPACING_M
    # A thin one has points along its length alone.
    assert (face == 1).sum() < 2.5 * 9 / SPACING_M


def test_a_wall_is_in_the_voxels_that_it_passes_and_in_no_other():
    semantics, moving = TrueOccupancy(Scene(parts_of([WALL]), ()), *CORNERS).at(0, np.eye(4), GRID)
    occupied = np.argwhere(semantics != FREE)
    assert set(occupied[:, 0]) == {12}
    assert occupied[:, 1:].min(axis=0).tolist() == [6, 6]
    assert set(semantics[semantics != FREE]) == {BUILDING}
    assert not moving.any()


def test_actors_are_where_they_are_at_the_step():
    actor = box_actor(CAR, (1.0, 1.0, 1.0), [[2.2, 0.2, 0.0], [8.2, 0.2, 0.0]], 0.5)
    truth = TrueOccupancy(Scene((), (actor,)), *CORNERS)
    for step, x_m in enumerate((2.2, 8.2)):
        semantics, moving = truth.at(step, np.eye(4), GRID)
        assert (moving == (semantics == CAR)).all()
        assert np.argwhere(moving)[:, 0].mean() == pytest.approx(2 * x_m - 0.5, abs=0.6)
