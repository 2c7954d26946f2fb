"""Calibration of the probability of occupied, against its definition."""

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import ObjectMiss, OccupiedCalibration, SafetyScores
from src.metrics.occupied_calibration import BINS, OCCUPIED, VOXELS, edges, level_of
from src.ontology import FREE, GROUND
from tests.metrics.inputs import LINE


@pytest.fixture
def frames(grid, random_batch):
    """Probabilities of four frames, their labels and velocities."""
    _, target, velocity = random_batch(0)
    generator = torch.Generator().manual_seed(0)
    return torch.rand(target.shape, generator=generator), target, velocity


def in_bubble(grid, target, velocity):
    reach_m = 5.0 * velocity.double().norm(dim=-1).clamp(min=5.0)
    near = grid.centers(torch.float64).norm(dim=-1) <= reach_m[:, None, None, None]
    return near & (target != 255)


def test_the_brier_score_and_the_counts_are_those_of_the_definition(grid, frames):
    occupied, target, velocity = frames
    metric = OccupiedCalibration(grid)
    metric.update(*frames)
    near = in_bubble(grid, target, velocity)
    said, true = occupied.double()[near], (target[near] != FREE).double()
    assert float(metric.compute()["occupied_brier"]) == pytest.approx(
        float((said - true).square().mean()), abs=1e-6
    )
    assert int(metric.bubble[:, VOXELS].sum()) == int(near.sum())
    assert int(metric.bubble[:, OCCUPIED].sum()) == int(true.sum())


def test_the_error_is_that_of_bins_of_equal_mass():
    """What is drawn as often as it is said has the error that chance leaves; said half as often, a
    quarter."""
    grid, velocity = VoxelGrid((0, -10, -10), (20, 10, 10), (20, 20, 20)), torch.ones(1, 3) * 5
    generator = torch.Generator().manual_seed(1)
    occupied, draws = torch.rand(2, 1, *grid.shape, generator=generator)
    target = torch.where(draws < occupied, 0, FREE)
    fair, timid = OccupiedCalibration(grid), OccupiedCalibration(grid)
    fair.update(occupied, target, velocity)
    timid.update(occupied / 2, target, velocity)
    assert fair.compute()["occupied_ece"] < 0.03
    assert float(timid.compute()["occupied_ece"]) == pytest.approx(0.25, abs=0.02)

    few = fair.equal_mass(fair.bubble.double())
    assert few.shape == (15, 4)
    assert few.sum(dim=0).tolist() == fair.bubble.sum(dim=0).tolist()
    assert few[:, VOXELS].max() < 1.5 * few[:, VOXELS].mean()


def test_the_tube_is_that_of_the_safety_scores(grid, frames):
    occupied, target, velocity = frames
    counts = OccupiedCalibration(grid).frame_counts(*frames)["tube"]
    labels = torch.where(occupied > 0.5, 0, FREE)
    expected = SafetyScores(grid).frame_counts(labels, target, velocity)["tube"]
    assert counts[:, :, VOXELS].sum(1).tolist() == expected.sum((1, 2)).tolist()
    assert counts[:, :, OCCUPIED].sum(1).tolist() == expected[:, 1].sum(1).tolist()


def test_an_object_has_the_highest_probability_near_it_and_is_missed_below_it(grid, frames):
    """At every threshold the objects below it are those that `ObjectMiss` calls missed."""
    occupied, target, velocity = frames
    sparse = torch.rand(target.shape, generator=torch.Generator().manual_seed(2)) < 0.5
    target = torch.where(sparse | (target == 255), target, FREE)
    objects = OccupiedCalibration(grid, tube_radius_m=8.0, tolerance_m=grid.voxel_m).frame_counts(
        occupied, target, velocity
    )["objects"]
    assert objects.sum() > 10
    miss = ObjectMiss(grid, near_m=8.0, seconds=2.0, tolerance_m=grid.voxel_m)
    for level in (60, 100, 120):
        labels = torch.where(level_of(occupied) >= level, 0, FREE)
        missed = miss.frame_counts(labels, target, velocity)["objects"][..., 1].sum(-1)
        assert objects[:, :level].sum(-1).tolist() == missed.tolist()


def test_levels_ascend_and_their_edges_are_probabilities():
    inner = edges()
    assert len(inner) == BINS - 1
    assert level_of(inner - 1e-9).tolist() == list(range(BINS - 1))
    assert level_of(torch.tensor([0.0, 1.0])).tolist() == [0, BINS - 1]


@pytest.mark.parametrize("value", [np.nan, -0.1, 1.1])
def test_what_is_no_probability_is_refused(value):
    metric = OccupiedCalibration(LINE)
    with pytest.raises(UserError, match="no probability"):
        metric.update(
            torch.full((1, *LINE.shape), value),
            torch.full((1, *LINE.shape), GROUND),
            torch.ones(1, 3),
        )
