"""KAR-mIoU: its definition against plain loops, and the metrics against its definition."""

import pytest
import torch

from src.metrics import KARMeanIoU, OccupancyScores
from src.metrics.functional import kar_mean_iou
from src.ontology import CLASSES
from tests.metrics.inputs import FOUR_CLASSES, assert_same, coins, random_logits, updated
from tests.metrics.loops import OTHER, PAPER, class_shares, counted_voxels, occupied_mean

EDGES = {
    "absent classes": lambda p, t, v: (p.clamp(max=2), t.where(t == 255, t.clamp(max=2)), v),
    "all unknown": lambda p, t, v: (p, torch.full_like(t, 255), v),
    "all free": lambda p, t, v: (torch.full_like(p, 8), torch.full_like(t, 8), v),
    "all wrong": lambda p, t, v: ((t.clamp(max=8) + 1) % 9, t, v),
    "standing still": lambda p, t, v: (p, t, torch.zeros_like(v)),
    "far too fast": lambda p, t, v: (p, t, 1e6 * v),
}

# A UAV at rest then has voxels exactly at the horizon, 6 m away.
AT_THE_HORIZON = PAPER | {"horizon_s": 1.2}


@pytest.fixture(params=[*range(2), *EDGES])
def batch(request, random_batch):
    """Random labels, and those at the edges of the definition."""
    spoil = EDGES.get(request.param)
    return spoil(*random_batch(7)) if spoil else random_batch(request.param)


# ------------------------------------------------------------------------------ the definition


@pytest.mark.parametrize("parameters", [PAPER, OTHER, AT_THE_HORIZON, PAPER | {"horizon_s": 0.0}])
def test_the_definition_is_that_of_plain_loops(grid, batch, parameters):
    voxels = counted_voxels(grid, batch, parameters=parameters)
    expected = class_shares(voxels, missed=1, phantom=1)
    score, by_class = kar_mean_iou(*batch, grid, **parameters)
    assert by_class.tolist() == pytest.approx(expected, abs=1e-7, nan_ok=True)
    assert float(score) == pytest.approx(occupied_mean(expected), abs=1e-7, nan_ok=True)


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


def test_speeds_score_as_the_velocities_that_have_them(grid, random_batch):
    preds, target, _ = random_batch(1, frames=3)
    velocity = torch.tensor([[3.0, -4.0, 12.0], [0.0, 0.0, 8.0], [-9.0, 12.0, 0.0]])
    by_velocity = updated(KARMeanIoU(grid), (preds, target, velocity))
    by_speed = updated(KARMeanIoU(grid), (preds, target, torch.tensor([13.0, 8.0, 15.0])))
    assert_same(by_velocity.counts, by_speed.counts)
