"""What the pretraining of the image encoder learns from, and how it is measured."""

import math

import pytest
import torch
import torch.nn.functional as F

from src.models.backbone import ResNet
from src.models.image_pretraining import ImagePretraining
from src.ontology import BUILDING, CAR, FREE, NUM_CLASSES


def batch_of(classes, depth_m):
    classes, depth_m = torch.tensor([[classes]]), torch.tensor([[depth_m]])
    return {"image": torch.zeros(1), "classes": classes, "depth_m": depth_m}


@pytest.fixture
def module(monkeypatch):
    """Predicts what is put into ``says``: class scores and logarithms of depth."""
    made = ImagePretraining(ResNet(18, 8), 16, 1e-3, 0.0)
    made.logged = {}
    monkeypatch.setattr(made, "forward", lambda image: made.says)
    monkeypatch.setattr(made, "log_dict", made.logged.update)
    monkeypatch.setattr(made, "log", lambda name, value, **_: made.logged.update({name: value}))
    return made


def logits_of(classes, sure=20.0):
    return sure * F.one_hot(torch.tensor([[classes]]), NUM_CLASSES).movedim(-1, 1).float()


def measured(module, *batches):
    """What a validation logs; each batch is what is said and what is true of its pixels."""
    for said, classes, log_depth, depth_m in batches:
        module.says = (logits_of(said), torch.tensor([[log_depth]]))
        module.validation_step(batch_of(classes, depth_m), 0)
    module.on_validation_epoch_end()
    return module.logged


def test_the_loss_is_of_all_classes_and_of_the_depth_where_something_is_seen(module):
    module.says = (torch.zeros(1, NUM_CLASSES, 1, 3), torch.tensor([[[0.0, 1.0, 7.0]]]))
    batch = batch_of([CAR, BUILDING, FREE], [math.e, math.e**3, 0.0])
    loss = module.training_step(batch, 0)
    assert module.logged["train/classes"] == pytest.approx(math.log(NUM_CLASSES), abs=1e-6)
    assert module.logged["train/log_depth"] == pytest.approx((1 + 2) / 2, abs=1e-5)
    assert loss == pytest.approx(math.log(NUM_CLASSES) + 1.5, abs=1e-5)


def test_where_nothing_is_seen_the_depth_costs_nothing(module):
    module.says = (logits_of([FREE, FREE]), torch.tensor([[[3.0, 4.0]]]))
    module.training_step(batch_of([FREE, FREE], [0.0, 0.0]), 0)
    assert module.logged["train/log_depth"] == 0


def test_a_class_that_is_nowhere_is_no_part_of_the_mean(module):
    logged = measured(module, ([CAR, FREE], [CAR, FREE], [0.0, 0.0], [1.0, 0.0]))
    assert logged["val/miou"] == logged["val/iou/car"] == 1
    assert logged["val/iou/vru"].isnan()


def test_validation_is_over_all_pixels_of_all_batches(module):
    logged = measured(
        module,
        ([CAR, CAR, FREE], [CAR, FREE, FREE], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([BUILDING, FREE, FREE], [CAR, CAR, CAR], [1.0, 2.0, 3.0], [1.0, 1.0, 1.0]),
    )
    expected = {"car": 1 / 5, "free": 1 / 4, "building": 0.0}
    for name, iou in expected.items():
        assert logged[f"val/iou/{name}"] == pytest.approx(iou)
    assert logged["val/miou"] == pytest.approx(sum(expected.values()) / 3)
    assert logged["val/log_depth"] == pytest.approx((0.5 + 1 + 2 + 3) / 4)

    logged = measured(module, ([FREE], [FREE], [0.0], [0.0]))
    assert logged["val/miou"] == 1, "each epoch is measured anew"
