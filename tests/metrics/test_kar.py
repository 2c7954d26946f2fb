"""KAR-mIoU against plain loops, on random and on adversarial batches."""

import pytest
import torch

from src.metrics import KARMeanIoU, OccupancyScores
from src.ontology import CLASSES
from tests.metrics.inputs import assert_same, scores_of, updated
from tests.metrics.loops import OTHER, PAPER, class_shares, counted_voxels, occupied_mean


def check(grid, batch, parameters=PAPER):
    expected = class_shares(counted_voxels(grid, batch, parameters=parameters), 1, 1)
    scores = scores_of(OccupancyScores(grid, **parameters), batch)
    per_class = [scores[f"kar_iou/{name}"] for name in CLASSES]
    assert per_class == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert scores["kar_miou"] == pytest.approx(occupied_mean(expected), abs=1e-6, nan_ok=True)
    kar_miou = updated(KARMeanIoU(grid, **parameters), batch).compute()
    assert float(kar_miou) == pytest.approx(scores["kar_miou"], abs=0, nan_ok=True)


@pytest.mark.parametrize("parameters", [PAPER, OTHER, PAPER | {"horizon_s": 0.0}])
@pytest.mark.parametrize("seed", range(4))
def test_random_batches_match_the_loops(grid, random_batch, seed, parameters):
    check(grid, random_batch(seed), parameters)


def absent_classes(preds, target, velocity):
    return preds.clamp(max=2), torch.where(target == 255, target, target.clamp(max=2)), velocity


def one_voxel(preds, target, velocity):
    lonely = torch.full_like(target, 255)
    lonely[0, 3, 2, 1] = 6
    return preds.fill_(8), lonely, velocity


def all_free(preds, target, velocity):
    return torch.full_like(preds, 8), torch.full_like(target, 8), velocity


def all_wrong(preds, target, velocity):
    return (target.clamp(max=8) + 1) % 9, target, velocity


def zero_speed(preds, target, velocity):
    return preds, target, torch.zeros_like(velocity)


def speed_far_beyond_the_grid(preds, target, velocity):
    return preds, target, 1e6 * velocity


@pytest.mark.parametrize(
    "change",
    [
        absent_classes,
        one_voxel,
        all_free,
        all_wrong,
        zero_speed,
        speed_far_beyond_the_grid,
    ],
)
def test_adversarial_batches_match_the_loops(grid, random_batch, change):
    check(grid, change(*random_batch(7)))


def test_speeds_score_as_the_velocities_that_have_them(grid, random_batch):
    preds, target, _ = random_batch(1, frames=3)
    velocity = torch.tensor([[3.0, -4.0, 12.0], [0.0, 0.0, 8.0], [-9.0, 12.0, 0.0]])
    by_velocity = updated(KARMeanIoU(grid), (preds, target, velocity))
    by_speed = updated(KARMeanIoU(grid), (preds, target, torch.tensor([13.0, 8.0, 15.0])))
    assert_same(by_velocity.tables, by_speed.tables)


@pytest.mark.parametrize("kind", ["missed", "phantom"])
def test_a_near_error_costs_more_than_a_far_one(grid, kind):
    def score(x):
        without = torch.full((1, *grid.shape), 8)
        without[0, :, 0, 0] = 5
        with_one = without.clone()
        with_one[0, x, 2, 1] = 5
        target, preds = (with_one, without) if kind == "missed" else (without, with_one)
        batch = (preds, target, torch.tensor([10.0]))
        return float(updated(KARMeanIoU(grid), batch).compute())

    assert score(0) < score(2) < score(5)


def test_correct_voxels_weigh_the_same_near_and_far(grid):
    def score(correct_x, wrong_x):
        target = torch.full((1, *grid.shape), 255)
        target[0, correct_x], target[0, wrong_x] = 5, 5
        preds = torch.full_like(target, 8)
        preds[0, correct_x] = 5
        batch = (preds, target, torch.tensor([10.0]))
        return float(updated(KARMeanIoU(grid), batch).compute())

    assert score(correct_x=0, wrong_x=3) == score(correct_x=5, wrong_x=3)
