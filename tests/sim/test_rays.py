"""Rays against triangles."""

import numpy as np
import pytest

from src.sim.rays import RayScene

FLOOR = np.array(
    [[[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[-9, -9, 5], [9, -9, 5], [0, 9, 5]]], float
)
DOWN = np.array([[0.0, 0.0, -1.0]])


def test_the_nearest_triangle_is_hit_from_either_side():
    rays = RayScene(FLOOR)
    origins_m = np.array([[0.0, 0, 8], [0, 0, 3], [0, 0, 3], [30, 0, 3], [0, 0, -2]])
    directions = np.concatenate([DOWN, DOWN, -DOWN, DOWN, DOWN])
    distance_m, face = rays.cast(origins_m, directions)
    assert distance_m == pytest.approx([3, 3, 2, np.inf, np.inf])
    assert face.tolist() == [1, 0, 1, -1, -1]


def test_a_slanted_ray_has_its_length():
    direction = np.array([[0.6, 0.0, -0.8]])
    distance_m, _ = RayScene(FLOOR[:1]).cast(np.array([[-2.0, 0, 4]]), direction)
    assert distance_m == pytest.approx([5.0])


def test_nothing_is_hit_in_an_empty_scene():
    distance_m, face = RayScene(np.zeros((0, 3, 3))).cast(np.zeros((3, 3)), np.repeat(DOWN, 3, 0))
    assert np.isinf(distance_m).all()
    assert face.tolist() == [-1, -1, -1]
