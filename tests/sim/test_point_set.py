"""Thinning: one point of a class in a cube, whatever the order and the size of the batches."""

import numpy as np

from src.ontology import BUILDING, THIN_STRUCTURE, VRU
from src.sim.point_set import POINT_CUBE_M, PointSet


def test_the_first_point_of_a_class_in_a_cube_is_kept():
    rng = np.random.default_rng(0)
    points_m = rng.uniform(-1.2, 1.3, (60_000, 3))
    class_id = rng.choice([BUILDING, THIN_STRUCTURE, VRU], 60_000).astype(np.uint8)
    kept = PointSet()
    for part in np.array_split(np.arange(60_000), 7):
        kept.add(points_m[part], class_id[part])
    cubes = np.c_[np.floor(points_m / POINT_CUBE_M).astype(int), class_id]
    expected = np.sort(np.unique(cubes, axis=0, return_index=True)[1])
    assert 10_000 < len(expected) < 50_000
    np.testing.assert_array_equal(kept.points()[0], points_m[expected])
    np.testing.assert_array_equal(kept.points()[1], class_id[expected])


def test_an_empty_set_has_no_points():
    assert [values.shape for values in PointSet().points()] == [(0, 3), (0,)]
