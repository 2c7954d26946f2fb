"""The dict of scores: agreement with torchmetrics, names, means and accumulation."""

import pytest
import torch
from torchmetrics.classification import MulticlassJaccardIndex

from src.errors import UserError
from src.metrics import OccupancyScores
from src.metrics.functional import is_compiled
from src.ontology import CAR, CLASSES, VRU
from tests.metrics.inputs import FOUR_CLASSES, scores_of


def jaccard(batches, num_classes=9, unknown=255):
    index = MulticlassJaccardIndex(num_classes, ignore_index=unknown, average=None)
    for preds, target, _ in batches:
        index.update(preds.long(), target.long())
    return index.compute().tolist()


def test_the_scores_are_those_of_torchmetrics_under_the_names_of_the_ontology(grid, random_batch):
    batches = [random_batch(seed) for seed in range(3)]
    scores = scores_of(OccupancyScores(grid), *batches)
    iou, kar_iou = list(scores.values())[3:12], list(scores.values())[12:]
    assert iou == pytest.approx(jaccard(batches), abs=1e-6)
    assert all(kar < one for kar, one in zip(kar_iou, iou))
    means = {
        "miou": sum(iou) / 9,
        "miou_occupied": sum(iou[:8]) / 8,
        "kar_miou": sum(kar_iou[:8]) / 8,
    }
    assert {name: scores[name] for name in means} == pytest.approx(means)
    per_class = [f"{family}/{name}" for family in ("iou", "kar_iou") for name in CLASSES]
    assert list(scores) == [*means, *per_class]

    unpenalized = scores_of(OccupancyScores(grid, penalty_scale=0.0), *batches)
    assert list(unpenalized.values())[12:] == iou


def test_a_class_that_is_only_predicted_scores_zero_and_one_that_never_occurs_not(
    grid, random_batch
):
    preds, target, velocity = random_batch(0)
    target[target == VRU] = CAR
    assert scores_of(OccupancyScores(grid), (preds, target, velocity))["iou/vru"] == 0

    preds[preds == VRU] = CAR
    scores = scores_of(OccupancyScores(grid), (preds, target, velocity))
    iou = [scores.pop(f"iou/{name}") for name in CLASSES]
    assert iou[VRU] != iou[VRU]
    assert scores["miou_occupied"] == pytest.approx((sum(iou[:VRU]) + iou[7]) / 7)


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("num_classes", [4, 15])
def test_other_classes_free_and_unknown_labels(grid, random_batch, num_classes, backend):
    preds, target, velocity = random_batch(0, num_classes=num_classes)
    batch = preds, torch.where(target == 255, -100, target.long()), velocity
    options = FOUR_CLASSES | {"num_classes": num_classes, "backend": backend}
    scores = scores_of(OccupancyScores(grid, **options), batch)
    iou = [scores[f"iou/{class_id}"] for class_id in range(num_classes)]
    assert iou == pytest.approx(jaccard([batch], num_classes, -100), abs=1e-6)
    assert scores["miou_occupied"] == pytest.approx(sum(iou[1:]) / (num_classes - 1))


def test_a_backend_that_there_is_not_is_refused():
    for backend, device in (("cupy", "cpu"), ("numba", "cuda")):
        with pytest.raises(UserError, match=rf"^backend: '?{backend}"):
            is_compiled(backend, torch.device(device))
