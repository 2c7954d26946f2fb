"""The distance field is exact up to its reach."""

import numpy as np
import pytest

from src.loop.distance_field import distance_at, distances

REACH = 5


def test_distances_are_those_to_the_nearest_of_all():
    rng = np.random.default_rng(0)
    occupied = rng.random((14, 11, 9)) < 0.01
    cells, centers = np.argwhere(occupied), np.indices(occupied.shape).reshape(3, -1).T
    exact = np.linalg.norm(centers[:, None] - cells, axis=-1).min(axis=1)
    exact = np.minimum(exact, REACH).reshape(occupied.shape)
    assert len(cells) > 3
    assert distances(occupied, REACH) == pytest.approx(exact, abs=1e-5)
    assert (distances(np.zeros_like(occupied), REACH) == REACH).all()


def test_between_centers_it_is_interpolated_and_outside_there_is_nothing():
    field = distances(np.arange(64).reshape(4, 4, 4) < 16, REACH)
    assert distance_at(field, np.array([1.5, 2.0, 2.0])) == pytest.approx(1.0)
    assert distance_at(field, np.array([2.0, 2.0, 2.0])) == pytest.approx(1.5)
    assert distance_at(field, np.array([-3.0, 2.0, 2.0])) == np.inf
