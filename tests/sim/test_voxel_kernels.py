"""The two numba loops against slow references."""

import numpy as np
import pytest

from src.sim.voxel_kernels import carve, count_votes

SHAPE, CELL_M, LOWER_M = (20, 16, 12), 0.5, np.array([-3.0, 2.0, -1.0])


def random_rays(count, seed):
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, rng.uniform(0.5, 12, count)


def test_carve_marks_what_a_sampled_ray_crosses_but_not_where_it_ends():
    origin_m = np.array([1.23, 5.41, 1.77])
    for direction, distance_m in zip(*random_rays(150, 0)):
        free = np.zeros(SHAPE, np.uint8)
        carve(free, LOWER_M, CELL_M, origin_m, direction[None], np.array([distance_m]))
        at_m = np.linspace(0, distance_m, 20_001)
        cells = np.floor((origin_m + at_m[:, None] * direction - LOWER_M) / CELL_M).astype(int)
        inside = ((cells >= 0) & (cells < SHAPE)).all(axis=1)
        end = cells[-1]
        passed = cells[inside & (cells != end).any(axis=1)]
        expected = np.zeros(SHAPE, np.uint8)
        expected[tuple(passed.T)] = 1
        # Samples miss cells of which a ray cuts less than half a millimetre off.
        missed = (free == 1) & (expected == 0)
        assert not ((free == 0) & (expected == 1)).any()
        assert missed.sum() <= 1
        if inside[-1]:
            assert free[tuple(end)] == 0


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rays_along_an_axis(axis, sign):
    origin_m, direction = LOWER_M + (np.array([10, 8, 6]) + 0.5) * CELL_M, np.zeros((1, 3))
    direction[0, axis] = sign
    free = np.zeros(SHAPE, np.uint8)
    carve(free, LOWER_M, CELL_M, origin_m, direction, np.array([3 * CELL_M]))
    cells = np.array([10, 8, 6]) + np.arange(3)[:, None] * direction.astype(int)
    expected = np.zeros(SHAPE, np.uint8)
    expected[tuple(cells.T)] = 1
    np.testing.assert_array_equal(free, expected)


def test_all_rays_mark_what_each_marks():
    origin_m = np.array([1.23, 5.41, 1.77])
    directions, distance_m = random_rays(50, 1)
    together, apart = np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
    carve(together, LOWER_M, CELL_M, origin_m, directions, distance_m)
    for k in range(50):
        carve(apart, LOWER_M, CELL_M, origin_m, directions[k : k + 1], distance_m[k : k + 1])
    np.testing.assert_array_equal(together, apart)
    assert 0 < together.sum() < together.size


@pytest.mark.parametrize("outside_m", [(-9.0, 5.0, 1.0), (1.0, 5.0, 5.1), (1.0, 1.9, 1.0)])
def test_a_ray_from_outside_the_map_marks_nothing(outside_m):
    free = np.zeros(SHAPE, np.uint8)
    carve(free, LOWER_M, CELL_M, np.array(outside_m), *random_rays(100, 2))
    assert not free.any()


def test_votes_are_numpys():
    rng = np.random.default_rng(0)
    points_m, class_id = rng.uniform(-15, 15, (5000, 3)), rng.integers(0, 8, 5000).astype(np.uint8)
    yaw = 0.7
    occ_from_world = np.eye(4)
    occ_from_world[:2, :2] = [[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]
    occ_from_world[:3, 3] = (1.0, 2.0, -3.0)
    votes = np.zeros((*SHAPE, 8), np.int32)
    count_votes(votes, LOWER_M, CELL_M, occ_from_world, points_m, class_id)
    points_occ = points_m @ occ_from_world[:3, :3].T + occ_from_world[:3, 3]
    edges = [LOWER_M[k] + np.arange(SHAPE[k] + 1) * CELL_M for k in range(3)]
    expected, _ = np.histogramdd(np.c_[points_occ, class_id], bins=[*edges, np.arange(9) - 0.5])
    assert votes.sum() > 20
    np.testing.assert_array_equal(votes, expected)


def test_a_point_just_below_the_grid_is_outside():
    votes = np.zeros((2, 2, 2, 8), np.int32)
    points_m = np.array([[-1e-9, 0.5, 0.5], [0.0, 0.5, 0.5], [2.0, 0.5, 0.5], [1.999, 0.5, 0.5]])
    count_votes(votes, np.zeros(3), 1.0, np.eye(4), points_m, np.zeros(4, np.uint8))
    assert votes[..., 0].nonzero()[0].tolist() == [0, 1]
    assert votes.sum() == 2
