"""KAR-mIoU: its definition against plain loops, and the metrics against its definition."""

import pytest
import torch

from src.metrics import KARMeanIoU, OccupancyScores
from src.metrics.functional import kar_mean_iou
from src.ontology import CLASSES
from tests.metrics.inputs import FOUR_CLASSES, assert_same, coins, random_logits, updated
from tests.metrics.loops import OTHER, PAPER, class_shares, counted_voxels, occupied_mean


def absent_classes(preds, target, velocity):
    return preds.clamp(max=2), torch.where(target == 255, target, target.clamp(max=2)), velocity


def one_voxel(preds, target, velocity):
    lonely = torch.full_like(target, 255)
    lonely[0, 3, 2, 1] = 6
    return preds.fill_(8), lonely, velocity


def all_unknown(preds, target, velocity):
    return preds, torch.full_like(target, 255), velocity


def all_free(preds, target, velocity):
    return torch.full_like(preds, 8), torch.full_like(target, 8), velocity


def all_wrong(preds, target, velocity):
    return (target.clamp(max=8) + 1) % 9, target, velocity


def standing_still(preds, target, velocity):
    return preds, target, torch.zeros_like(velocity)


def far_too_fast(preds, target, velocity):
    return preds, target, 1e6 * velocity


EDGES = [absent_classes, one_voxel, all_unknown, all_free, all_wrong, standing_still, far_too_fast]

# A UAV at rest then has voxels exactly at the horizon, 6 m away.
AT_THE_HORIZON = PAPER | {"horizon_s": 1.2}


@pytest.fixture(params=[*range(4), *EDGES], ids=lambda each: getattr(each, "__name__", each))
def batch(request, random_batch):
    """Random labels, and those at the edges of the definition."""
    if isinstance(request.param, int):
        return random_batch(request.param)
    return request.param(*random_batch(7))


# ------------------------------------------------------------------------------ the definition


@pytest.mark.parametrize("parameters", [PAPER, OTHER, AT_THE_HORIZON, PAPER | {"horizon_s": 0.0}])
def test_the_definition_is_that_of_plain_loops(grid, batch, parameters):
    voxels = counted_voxels(grid, batch, parameters=parameters)
    expected = class_shares(voxels, missed=1, phantom=1)
    score, by_class = kar_mean_iou(*batch, grid, **parameters)
    assert by_class.tolist() == pytest.approx(expected, abs=1e-7, nan_ok=True)
    assert float(score) == pytest.approx(occupied_mean(expected), abs=1e-7, nan_ok=True)


def test_a_logit_counts_as_its_class_and_a_mask_as_unknown(grid, random_batch):
    _, target, velocity = random_batch(0)
    logits, mask = random_logits(1, target), coins(2, target)
    actual = kar_mean_iou(logits, target, velocity, grid, mask)
    unknown = target.masked_fill(~mask, 255)
    assert_same(actual, kar_mean_iou(logits.argmax(1), unknown, velocity, grid))


# ------------------------------------------------------------------------ what computes it faster


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("parameters", [PAPER, OTHER, AT_THE_HORIZON])
def test_the_metrics_have_the_bits_of_the_definition(grid, batch, backend, parameters):
    for masked, of_logits in ((False, False), (True, False), (False, True)):
        preds, target, velocity = batch
        mask = coins(3, target) if masked else None
        preds = random_logits(4, target) if of_logits else preds
        score, by_class = kar_mean_iou(preds, target, velocity, grid, mask, **parameters)

        given = (preds, target, velocity, mask)
        options = {"backend": backend, **parameters}
        assert_same(updated(KARMeanIoU(grid, **options), given).compute(), score.float())
        scores = updated(OccupancyScores(grid, **options), given).compute()
        assert_same(scores["kar_miou"], score.float())
        actual = torch.stack([scores[f"kar_iou/{name}"] for name in CLASSES])
        assert_same(actual, by_class.float())


def test_other_classes_free_and_unknown_labels(grid, four_classes):
    score, by_class = kar_mean_iou(*four_classes, grid, **FOUR_CLASSES)
    kar = updated(KARMeanIoU(grid, **FOUR_CLASSES), four_classes)
    assert_same(kar.compute(), score.float())
    assert_same(score, by_class[1:].nanmean())


# --------------------------------------------------------------------------------- what it is for


def test_speeds_score_as_the_velocities_that_have_them(grid, random_batch):
    preds, target, _ = random_batch(1, frames=3)
    velocity = torch.tensor([[3.0, -4.0, 12.0], [0.0, 0.0, 8.0], [-9.0, 12.0, 0.0]])
    by_velocity = updated(KARMeanIoU(grid), (preds, target, velocity))
    by_speed = updated(KARMeanIoU(grid), (preds, target, torch.tensor([13.0, 8.0, 15.0])))
    assert_same(by_velocity.tables, by_speed.tables)


def score_of(preds, target, grid):
    return float(updated(KARMeanIoU(grid), (preds, target, torch.tensor([10.0]))).compute())


@pytest.mark.parametrize("kind", ["missed", "phantom"])
def test_a_near_error_costs_more_than_a_far_one(grid, kind):
    def score(x):
        without = torch.full((1, *grid.shape), 8)
        without[0, :, 0, 0] = 5
        with_one = without.clone()
        with_one[0, x, 2, 1] = 5
        missed = kind == "missed"
        return score_of(*((without, with_one) if missed else (with_one, without)), grid)

    assert score(0) < score(2) < score(5)


def test_correct_voxels_weigh_the_same_near_and_far(grid):
    def score(correct_x, wrong_x):
        target = torch.full((1, *grid.shape), 255)
        target[0, correct_x], target[0, wrong_x] = 5, 5
        preds = torch.full_like(target, 8)
        preds[0, correct_x] = 5
        return score_of(preds, target, grid)

    assert score(correct_x=0, wrong_x=3) == score(correct_x=5, wrong_x=3)
