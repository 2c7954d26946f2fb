"""The map lies still in the world, gathers evidence, and forgets what drives off."""

import numpy as np
import pytest

from src.errors import UserError
from src.geometry import VoxelGrid
from src.loop.belief import MOST, Belief, BeliefMap, Fusion

GRID = VoxelGrid((0.0, -5.0, -5.0), (10.0, 5.0, 5.0), (20, 20, 20))
SHAPE = (48, 48, 24)


def believed(occupied=(), known=None, movable=False, probability=1.0):
    belief = Belief(*(np.zeros(GRID.shape, kind) for kind in (np.float32, bool, bool, np.uint8)))
    belief.known[:] = True if known is None else known
    for cell in occupied:
        belief.occupied[cell], belief.movable[cell] = probability, movable
    return belief


def at(x_m, y_m=0.0, z_m=0.0, yaw_rad=0.0):
    matrix = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    matrix[:2, :2], matrix[:3, 3] = [[cos, -sin], [sin, cos]], (x_m, y_m, z_m)
    return matrix


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.0])
def test_what_is_believed_lies_where_it_is_in_the_world(yaw_rad):
    belief, matrix = BeliefMap(SHAPE, 0.5, 0.5), at(3.1, 4.2, 5.3, yaw_rad)
    belief.update(believed([(10, 3, 15)]), GRID, matrix, 0.2)
    center_m = (matrix @ [5.25, -3.25, 2.75, 1])[:3]
    cell_m = (np.argwhere(belief.occupied(0.5)) + 0.5) * 0.5 + belief.lower_m
    assert len(cell_m) == 1
    assert np.abs(cell_m[0] - center_m).max() <= 0.25 + 1e-9
    assert belief.probability_near(center_m, 0.5) > 0.9
    assert belief.probability_near(center_m + np.array([3, 0, 0]), 0.5) < 0.2


def test_it_moves_along_and_keeps_its_place_in_the_world():
    belief = BeliefMap(SHAPE, 0.5, 0.5)
    belief.update(believed([(10, 10, 10)]), GRID, at(0.0), 0.2)
    before_m = np.argwhere(belief.occupied(0.5)) * 0.5 + belief.lower_m
    nothing = believed(known=False)
    belief.update(nothing, GRID, at(4.0, -2.0, 1.0), 0.2)
    after_m = np.argwhere(belief.occupied(0.5)) * 0.5 + belief.lower_m
    assert (before_m == after_m).all()
    belief.update(nothing, GRID, at(100.0), 0.2)
    belief.update(nothing, GRID, at(0.0), 0.2)
    assert not belief.seen.any()


def test_what_may_drive_off_is_forgotten_and_what_stands_is_not():
    for movable, left in ((True, 0), (False, 1)):
        belief = BeliefMap(SHAPE, 0.5, 0.5)
        belief.update(believed([(10, 10, 10)], movable=movable), GRID, at(0.0), 0.2)
        for _ in range(10):
            belief.update(believed(known=False), GRID, at(0.0), 0.2)
        assert belief.occupied(0.5).sum() == left


def test_the_threshold_is_a_probability_and_what_is_seen_to_be_free_again_is_free():
    belief = BeliefMap(SHAPE, 0.5, 0.5)
    belief.update(believed([(10, 10, 10)], probability=0.6), GRID, at(0.0), 0.2)
    assert (belief.occupied(0.59).sum(), belief.occupied(0.61).sum()) == (1, 0)
    belief.update(believed(), GRID, at(0.0), 0.2)
    assert not belief.occupied(0.5).any()


@pytest.mark.parametrize("wrong", [np.nan, 1.5, -0.1])
def test_what_is_no_probability_is_refused(wrong):
    belief = BeliefMap(SHAPE, 0.5, 0.5)
    with pytest.raises(UserError, match="belief"):
        belief.update(believed([(0, 0, 0)], probability=wrong), GRID, at(0.0), 0.2)


def test_evidence_counts_half_at_its_distance_and_nothing_where_it_is_neutral():
    probabilities, distances_m = np.array([0.3, 0.6, 0.6]), np.array([0.0, 0.0, 10.0])
    plain = Fusion().evidence(probabilities, distances_m)
    assert plain == pytest.approx(np.log([0.3 / 0.7, 1.5, 1.5]), abs=1e-6)
    near, far = Fusion(half_m=10.0).evidence(probabilities, distances_m)[1:]
    assert far == pytest.approx(near / 2)
    wary = Fusion(neutral=0.3).evidence(probabilities, distances_m)
    assert wary[0] == pytest.approx(0.0, abs=1e-6)
    assert wary[1] > plain[1]


def test_a_far_voxel_is_believed_later_than_a_near_one():
    belief, said = BeliefMap(SHAPE, 0.5, 0.5, Fusion(half_m=2.0)), believed()
    said.occupied[:] = 0.9
    belief.update(said, GRID, at(0.0), 0.2)
    near, far = (belief.probability_near(np.array([x_m, 0.25, 0.25]), 0.3) for x_m in (1.0, 9.0))
    assert 0.5 < far < near < 1 / (1 + np.exp(-MOST))


@pytest.mark.parametrize("key", ["neutral", "half_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_fusion_that_makes_no_sense_is_refused(key, value):
    with pytest.raises(UserError, match=f"task.fusion.{key}"):
        Fusion(**{key: value})
