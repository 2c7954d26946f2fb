"""KARSensitivity: every setting is a KARMeanIoU of its own."""

import math
from itertools import product

import pytest
import torch

from src.errors import UserError
from src.metrics import KARMeanIoU, KARSensitivity
from src.metrics.sensitivity import GRID, PARAMETERS

FEW = {"horizon_s": (1.5, 5.0), "penalty_scale": (0.0, 2.0, 7.0)}


def coins(seed, like):
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(seed)) < 0.5


def updated(metric, *batches):
    for batch in batches:
        metric.update(*batch)
    return metric


def state(metric):
    return {name: table.clone() for name, table in metric.tables.items()}


def same(a, b):
    return all(torch.equal(a[name], b[name]) for name in a)


def check(grid, *batches, values=GRID):
    metric = updated(KARSensitivity(grid, values), *batches)
    found = list(map(float, metric.compute().values()))
    expected = [
        float(updated(KARMeanIoU(grid, **setting), *batches).compute())
        for setting in metric.settings.to_dict("records")
    ]
    assert found == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return found


def test_every_setting_is_kar_miou_with_these_parameters(grid, random_batch):
    found = check(grid, random_batch(0), random_batch(1))
    assert len(found) == 81
    assert len(set(found)) > 50


@pytest.mark.parametrize("seed", range(3))
def test_random_batches_and_other_values(grid, random_batch, seed):
    found = check(grid, random_batch(seed), values=FEW)
    assert found[0] > found[1] > found[2]


def test_a_mask_restricts_every_setting(grid, random_batch):
    batch = random_batch(2)
    assert check(grid, (*batch, coins(0, batch[0])), values=FEW) != check(grid, batch, values=FEW)


def test_nothing_counted_is_nan(grid, random_batch):
    preds, target, velocity = random_batch(0)
    for batch in (
        (preds, torch.full_like(target, 255), velocity),
        (preds[:0], target[:0], velocity[:0]),
    ):
        assert all(math.isnan(score) for score in check(grid, batch, values=FEW))


def test_the_settings_are_in_the_order_of_the_scores(grid, random_batch):
    metric = updated(KARSensitivity(grid, dict(reversed(FEW.items()))), random_batch(0))
    settings = metric.settings
    assert list(settings) == list(PARAMETERS)
    rows = [list(map(float, row)) for row in settings.itertuples(index=False)]
    assert rows == [[5.0, h, 0.5, s] for h, s in product(*FEW.values())]
    assert list(metric.compute()) == [f"kar_miou {row}" for row in rows]


def test_without_values_there_is_the_setting_of_the_paper(grid, random_batch):
    metric = updated(KARSensitivity(grid, {}), random_batch(0))
    kar = updated(KARMeanIoU(grid), random_batch(0))
    assert list(metric.compute()) == ["kar_miou [5.0, 5.0, 0.5, 2.0]"]
    assert float(*metric.compute().values()) == pytest.approx(float(kar.compute()), abs=1e-7)


def test_other_classes_free_and_unknown_labels(grid, random_batch):
    preds, target, velocity = random_batch(0, num_classes=4)
    target = torch.where(target == 255, -100, target.long())
    labels = {"num_classes": 4, "free_index": 0, "ignore_index": -100}
    batch = (preds, target, velocity)
    metric = updated(KARSensitivity(grid, {"penalty_scale": (3.0,)}, **labels), batch)
    kar = updated(KARMeanIoU(grid, penalty_scale=3.0, **labels), batch)
    assert float(*metric.compute().values()) == pytest.approx(float(kar.compute()), abs=1e-6)


def test_logits_score_as_the_labels_of_their_maximum(grid, random_batch):
    _, target, velocity = random_batch(0)
    logits = torch.randn(4, 9, *grid.shape, generator=torch.Generator().manual_seed(0))
    by_logits = updated(KARSensitivity(grid, FEW), (logits, target, velocity))
    by_labels = updated(KARSensitivity(grid, FEW), (logits.argmax(1), target, velocity))
    assert same(state(by_logits), state(by_labels))


@pytest.mark.parametrize("size", [1, 2, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, random_batch, size):
    preds, target, velocity = random_batch(0, frames=7)
    batch = (preds, target, velocity, coins(0, preds))
    splits = list(zip(*(tensor.split(size) for tensor in batch)))
    in_parts = updated(KARSensitivity(grid, FEW), *reversed(splits))
    at_once = updated(KARSensitivity(grid, FEW), batch)
    assert same(state(in_parts), state(at_once))
    assert at_once.excess.any()


# -------------------------------------------------------------------------------------- errors


BAD_BATCHES = {
    "target id 9": ("target:", lambda p, t, v: (p, t.fill_(9), v)),
    "preds id 9": ("preds:", lambda p, t, v: (p.fill_(9), t, v)),
    "preds of another batch": ("preds:", lambda p, t, v: (p[:2], t, v)),
    "velocity of another batch": ("velocity:", lambda p, t, v: (p, t, v[:3])),
    "velocity with NaN": ("velocity:", lambda p, t, v: (p, t, v.fill_(torch.nan))),
    "mask of bytes": ("mask:", lambda p, t, v: (p, t, v, t)),
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, random_batch, call, what):
    names, spoil = BAD_BATCHES[what]
    metric = updated(KARSensitivity(grid, FEW), random_batch(0))
    before = state(metric)
    with pytest.raises(UserError, match=f"^{names}"):
        getattr(metric, call)(*spoil(*random_batch(1)))
    assert same(state(metric), before)
    assert metric.update_count == 1


def test_a_parameter_of_another_name_is_refused(grid):
    with pytest.raises(UserError, match=r"^gamma: is none of .*penalty_scale"):
        KARSensitivity(grid, {"penalty_scale": (1.0,), "gamma": (1.0,)})


@pytest.mark.parametrize(
    ("values", "said"), [((), "has no value"), ((1.0, 2.0, 1.0), "names a value twice")]
)
def test_no_values_and_repeated_ones_are_refused(grid, values, said):
    with pytest.raises(UserError, match=f"^horizon_s: .*{said}"):
        KARSensitivity(grid, {"horizon_s": values})


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_value_that_makes_no_sense_is_refused_by_name(grid, name):
    with pytest.raises(UserError, match=f"^{name}:"):
        KARSensitivity(grid, {name: (1.0, -1.0)})


@pytest.mark.parametrize(
    "labels", [{"num_classes": 16}, {"num_classes": 1}, {"free_index": 9}, {"ignore_index": 3}]
)
def test_labels_that_make_no_sense_are_refused_by_name(grid, labels):
    with pytest.raises(UserError, match=f"^{next(iter(labels))}:"):
        KARSensitivity(grid, FEW, **labels)
