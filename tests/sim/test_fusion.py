"""Fusion: the loops over rays and points against slow references, and thinning."""

import numpy as np
import pytest

from src.ontology import BUILDING, THIN_STRUCTURE, VRU
from src.sim.fusion import POINT_CUBE_M, PointSet
from src.sim.voxel_kernels import Lattice, carve, count_votes

SHAPE, CELL_M, LOWER_M = (20, 16, 12), 0.5, np.array([-3.0, 2.0, -1.0])
CELLS = Lattice(LOWER_M, CELL_M)


def random_rays(count, seed):
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, rng.uniform(0.5, 12, count)


def carved(origin_m, directions, distance_m):
    free = np.zeros(SHAPE, np.uint8)
    carve(free, CELLS, origin_m, directions, distance_m)
    return free == 1


def test_carve_marks_what_a_sampled_ray_crosses_but_not_where_it_ends():
    origin_m = np.array([1.23, 5.41, 1.77])
    directions, distance_m = random_rays(150, 0)
    # Along an axis a ray meets no border of the other two.
    directions[:6] = np.concatenate([np.eye(3), -np.eye(3)])

    marked = np.zeros(SHAPE, dtype=bool)
    for direction, length_m in zip(directions, distance_m):
        free = carved(origin_m, direction[None], np.array([length_m]))
        marked |= free
        at_m = np.linspace(0, length_m, 20_001)
        cells = np.floor((origin_m + at_m[:, None] * direction - LOWER_M) / CELL_M).astype(int)
        inside = ((cells >= 0) & (cells < SHAPE)).all(axis=1)
        end = cells[-1]
        expected = np.zeros(SHAPE, dtype=bool)
        expected[tuple(cells[inside & (cells != end).any(axis=1)].T)] = True

        # Samples miss cells of which a ray cuts less than half a millimetre off.
        assert free[expected].all()
        assert (free & ~expected).sum() <= 1
        if inside[-1]:
            assert not free[tuple(end)]

    # All rays together mark what each marks.
    np.testing.assert_array_equal(carved(origin_m, directions, distance_m), marked)
    assert 0 < marked.sum() < marked.size


def test_votes_are_numpys():
    rng = np.random.default_rng(0)
    points_m, class_id = rng.uniform(-15, 15, (5000, 3)), rng.integers(0, 8, 5000).astype(np.uint8)
    yaw = 0.7
    occ_from_world = np.eye(4)
    occ_from_world[:2, :2] = [[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]
    occ_from_world[:3, 3] = (1.0, 2.0, -3.0)
    votes = np.zeros((*SHAPE, 8), np.int32)
    count_votes(votes, CELLS, occ_from_world, points_m, class_id)
    points_occ = points_m @ occ_from_world[:3, :3].T + occ_from_world[:3, 3]
    edges = [LOWER_M[k] + np.arange(SHAPE[k] + 1) * CELL_M for k in range(3)]
    expected, _ = np.histogramdd(np.c_[points_occ, class_id], bins=[*edges, np.arange(9) - 0.5])
    assert votes.sum() > 20
    np.testing.assert_array_equal(votes, expected)


def test_a_point_just_below_the_grid_is_outside():
    votes = np.zeros((2, 2, 2, 8), np.int32)
    points_m = np.array([[-1e-9, 0.5, 0.5], [0.0, 0.5, 0.5], [2.0, 0.5, 0.5], [1.999, 0.5, 0.5]])
    count_votes(votes, Lattice(np.zeros(3), 1.0), np.eye(4), points_m, np.zeros(4, np.uint8))
    assert votes[..., 0].nonzero()[0].tolist() == [0, 1]
    assert votes.sum() == 2


@pytest.mark.parametrize("gathered", [0, 20_000, 500_000])
def test_the_first_point_of_a_class_in_a_cube_is_kept(monkeypatch, gathered):
    monkeypatch.setattr("src.sim.fusion.GATHERED", gathered)
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
