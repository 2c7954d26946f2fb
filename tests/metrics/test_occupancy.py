"""The dict of scores: agreement with torchmetrics, names, means and accumulation."""

import pytest
import torch
from torchmetrics.classification import MulticlassJaccardIndex

from src.metrics import OccupancyScores
from src.ontology import CLASSES
from tests.metrics.inputs import FOUR_CLASSES, updated

MEANS = ["miou", "miou_occupied", "kar_miou"]


def scores_of(grid, *batches, **arguments):
    return updated(OccupancyScores(grid, **arguments), *batches).compute()


@pytest.mark.parametrize("family", ["iou", "kar_iou"])
def test_without_penalty_classes_score_as_in_torchmetrics(grid, random_batch, family):
    scores = scores_of(grid, *(random_batch(seed) for seed in range(3)), penalty_scale=0.0)
    jaccard = MulticlassJaccardIndex(9, ignore_index=255, average=None)
    for seed in range(3):
        preds, target, _ = random_batch(seed)
        jaccard.update(preds.long(), target.long())
    ours = torch.stack([scores[f"{family}/{name}"] for name in CLASSES])
    torch.testing.assert_close(ours, jaccard.compute(), atol=1e-6, rtol=0)
    assert ours.min() > 0


def test_the_names_are_those_of_the_ontology(grid, random_batch):
    scores = scores_of(grid, random_batch(0))
    per_class = [f"{family}/{name}" for family in ("iou", "kar_iou") for name in CLASSES]
    assert list(scores) == MEANS + per_class
    assert all(value.ndim == 0 for value in scores.values())


def test_the_means_are_over_nine_and_over_eight_classes(grid, random_batch):
    scores = scores_of(grid, random_batch(0))
    iou = torch.stack([scores[f"iou/{name}"] for name in CLASSES])
    kar_iou = torch.stack([scores[f"kar_iou/{name}"] for name in CLASSES])
    torch.testing.assert_close(scores["miou"], iou.mean())
    torch.testing.assert_close(scores["miou_occupied"], iou[:8].mean())
    torch.testing.assert_close(scores["kar_miou"], kar_iou[:8].mean())
    assert (kar_iou < iou).all()


def test_a_class_that_never_occurs_is_nan_and_left_out_of_the_means(grid, random_batch):
    preds, target, velocity = random_batch(0)
    preds[preds == 6] = 5
    target[target == 6] = 5
    scores = scores_of(grid, (preds, target, velocity))
    assert scores["iou/vru"].isnan()
    assert scores["kar_iou/vru"].isnan()
    others = [scores[f"iou/{name}"] for name in CLASSES if name not in ("vru", "free")]
    torch.testing.assert_close(scores["miou_occupied"], torch.stack(others).mean())


def test_a_class_that_is_only_predicted_scores_zero(grid, random_batch):
    preds, target, velocity = random_batch(0)
    target[target == 6] = 5
    assert (preds[target != 255] == 6).any()
    assert scores_of(grid, (preds, target, velocity))["iou/vru"] == 0


def test_counts_accumulate_over_frames_instead_of_a_mean_of_scores(grid):
    target = torch.full((2, *grid.shape), 255)
    target[0, 0, 0, :2] = 5
    target[1, 0] = 5
    preds = torch.full_like(target, 8)
    preds[0, 0, 0, :2] = 5
    speed = torch.tensor([5.0])
    scores = scores_of(grid, *((preds[b : b + 1], target[b : b + 1], speed) for b in range(2)))
    assert float(scores["iou/car"]) == pytest.approx(2 / 17)


def test_other_classes_free_and_unknown_labels(grid, four_classes):
    preds, target, _ = four_classes
    scores = scores_of(grid, four_classes, **FOUR_CLASSES)
    iou = torch.stack([scores[f"iou/{class_id}"] for class_id in range(4)])
    jaccard = MulticlassJaccardIndex(4, ignore_index=-100, average=None)
    jaccard.update(preds.long(), target)
    torch.testing.assert_close(iou, jaccard.compute(), atol=1e-6, rtol=0)
    torch.testing.assert_close(scores["miou_occupied"], iou[1:].mean())
