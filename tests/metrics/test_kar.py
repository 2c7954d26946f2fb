"""KAR-mIoU against plain loops, on random and on adversarial batches."""

import math

import pytest
import torch

from src.metrics import KARMeanIoU, OccupancyScores
from src.ontology import CLASSES

PAPER = {"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0}
OTHER = {"horizon_s": 1.5, "decay_per_s": 0.1, "penalty_scale": 7.0, "min_speed_mps": 9.0}


def occupied_mean(kar_iou):
    present = [value for value in kar_iou[:8] if not math.isnan(value)]
    return sum(present) / len(present) if present else math.nan


def check(grid, batch, kar_iou_by_loops, **parameters):
    expected = kar_iou_by_loops(*batch, **parameters)
    metric, scores = KARMeanIoU(grid, **parameters), OccupancyScores(grid, **parameters)
    metric.update(*batch)
    scores.update(*batch)
    per_class = [float(scores.compute()[f"kar_iou/{name}"]) for name in CLASSES]
    assert per_class == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert float(metric.compute()) == pytest.approx(occupied_mean(expected), abs=1e-6, nan_ok=True)
    assert torch.equal(metric.compute().nan_to_num(-1), scores.compute()["kar_miou"].nan_to_num(-1))


@pytest.mark.parametrize("parameters", [PAPER, OTHER, PAPER | {"horizon_s": 0.0}])
@pytest.mark.parametrize("seed", range(4))
def test_random_batches_match_the_loops(grid, random_batch, kar_iou_by_loops, seed, parameters):
    check(grid, random_batch(seed), kar_iou_by_loops, **parameters)


def absent_classes(preds, target, velocity):
    return preds.clamp(max=2), torch.where(target == 255, target, target.clamp(max=2)), velocity


def all_unknown(preds, target, velocity):
    return preds, torch.full_like(target, 255), velocity


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
        all_unknown,
        one_voxel,
        all_free,
        all_wrong,
        zero_speed,
        speed_far_beyond_the_grid,
    ],
)
def test_adversarial_batches_match_the_loops(grid, random_batch, kar_iou_by_loops, change):
    check(grid, change(*random_batch(7)), kar_iou_by_loops)


def test_a_mask_restricts_what_is_counted(grid, random_batch, kar_iou_by_loops):
    preds, target, velocity = random_batch(3)
    mask = torch.rand(target.shape, generator=torch.Generator().manual_seed(0)) < 0.5
    metric = KARMeanIoU(grid)
    metric.update(preds, target, velocity, mask)
    expected = occupied_mean(kar_iou_by_loops(preds, target, velocity, mask=mask))
    assert float(metric.compute()) == pytest.approx(expected, abs=1e-6)
    assert expected != pytest.approx(occupied_mean(kar_iou_by_loops(preds, target, velocity)))


def test_speeds_score_as_the_velocities_that_have_them(grid, random_batch):
    preds, target, _ = random_batch(1, frames=3)
    velocity = torch.tensor([[3.0, -4.0, 12.0], [0.0, 0.0, 8.0], [-9.0, 12.0, 0.0]])
    by_velocity, by_speed = KARMeanIoU(grid), KARMeanIoU(grid)
    by_velocity.update(preds, target, velocity)
    by_speed.update(preds, target, torch.tensor([13.0, 8.0, 15.0]))
    assert torch.equal(by_velocity.excess, by_speed.excess)


@pytest.mark.parametrize("kind", ["missed", "phantom"])
def test_a_near_error_costs_more_than_a_far_one(grid, kind):
    def score(x):
        without = torch.full((1, *grid.shape), 8)
        without[0, :, 0, 0] = 5
        with_one = without.clone()
        with_one[0, x, 2, 1] = 5
        target, preds = (with_one, without) if kind == "missed" else (without, with_one)
        metric = KARMeanIoU(grid)
        metric.update(preds, target, torch.tensor([10.0]))
        return float(metric.compute())

    assert score(0) < score(2) < score(5)


def test_correct_voxels_weigh_the_same_near_and_far(grid):
    def score(correct_x, wrong_x):
        target = torch.full((1, *grid.shape), 255)
        target[0, correct_x], target[0, wrong_x] = 5, 5
        preds = torch.full_like(target, 8)
        preds[0, correct_x] = 5
        metric = KARMeanIoU(grid)
        metric.update(preds, target, torch.tensor([10.0]))
        return float(metric.compute())

    assert score(correct_x=0, wrong_x=3) == score(correct_x=5, wrong_x=3)
