"""Thinning: one point of a class in a cube, whatever the order and the size of the batches."""

import numpy as np

from src.ontology import BUILDING, THIN_STRUCTURE, VRU
from src.sim.point_set import POINT_CUBE_M, PointSet


def scattered(count, seed=0):
    rng = np.random.default_rng(seed)
    points_m = rng.uniform(-1.2, 1.3, (count, 3))
    return points_m, rng.choice([BUILDING, THIN_STRUCTURE, VRU], count).astype(np.uint8)


def first_in_cubes(points_m, class_id):
    cubes = np.c_[np.floor(points_m / POINT_CUBE_M).astype(int), class_id]
    return np.sort(np.unique(cubes, axis=0, return_index=True)[1])


def test_the_first_point_of_a_class_in_a_cube_is_kept():
    points_m, class_id = scattered(60_000)
    kept = PointSet()
    for part in np.array_split(np.arange(60_000), 7):
        kept.add(points_m[part], class_id[part])
    expected = first_in_cubes(points_m, class_id)
    assert 10_000 < len(expected) < 50_000
    np.testing.assert_array_equal(kept.points()[0], points_m[expected])
    np.testing.assert_array_equal(kept.points()[1], class_id[expected])


def test_what_was_kept_stays_known_while_the_set_grows():
    points_m, class_id = scattered(40_000)
    kept = PointSet()
    kept.add(points_m, class_id)
    before = len(kept.points()[0])
    kept.add(points_m + 100.0, class_id)
    kept.add(points_m, class_id)
    assert len(kept.points()[0]) == before + len(first_in_cubes(points_m + 100.0, class_id))


def test_an_empty_set_has_no_points():
    points_m, class_id = PointSet().points()
    assert points_m.shape == (0, 3)
    assert class_id.shape == (0,)
