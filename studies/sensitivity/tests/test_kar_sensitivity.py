"""KARSensitivity: every setting is a KARMeanIoU of its own."""

from itertools import product

import pytest

from src.errors import UserError
from src.metrics import KARMeanIoU
from studies.sensitivity.metric import GRID, PARAMETERS, KARSensitivity
from tests.metrics.inputs import FOUR_CLASSES, assert_same, updated

FEW = {"horizon_s": (1.5, 5.0), "penalty_scale": (0.0, 2.0, 7.0)}


@pytest.mark.parametrize(("values", "settings"), [(GRID, 81), (FEW, 6), ({}, 1)])
def test_every_setting_is_kar_miou_with_these_parameters(grid, random_batch, values, settings):
    actual = check(grid, random_batch(0), random_batch(1), values=values)
    assert len(actual) == settings
    assert len(set(actual)) > settings / 2


def test_other_classes_free_and_unknown_labels(grid, four_classes):
    check(grid, four_classes, values={"penalty_scale": (3.0,)}, **FOUR_CLASSES)


def check(grid, *batches, values, **classes):
    metric = updated(KARSensitivity(grid, values, **classes), *batches)
    expected = [
        float(updated(KARMeanIoU(grid, **setting, **classes), *batches).compute())
        for setting in metric.settings.to_dict("records")
    ]
    actual = list(map(float, metric.compute().values()))
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return actual


def test_the_settings_are_in_the_order_of_the_scores(grid, random_batch):
    metric = updated(KARSensitivity(grid, dict(reversed(FEW.items()))), random_batch(0))
    settings = metric.settings
    assert list(settings) == list(PARAMETERS)
    rows = [list(map(float, row)) for row in settings.itertuples(index=False)]
    assert rows == [[5.0, h, 0.5, s] for h, s in product(*FEW.values())]
    assert list(metric.compute()) == [f"kar_miou {row}" for row in rows]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"penalty_scale": (1.0,), "gamma": (1.0,)}, r"^gamma: is none of .*penalty_scale"),
        ({"horizon_s": ()}, "^horizon_s: .*has no value"),
        ({"horizon_s": (1.0, 2.0, 1.0)}, "^horizon_s: .*names a value twice"),
        *(({name: (1.0, -1.0)}, f"^{name}:") for name in PARAMETERS),
    ],
)
def test_values_that_make_no_sense_are_refused_by_name(grid, values, message):
    with pytest.raises(UserError, match=message):
        KARSensitivity(grid, values)


def test_any_split_into_batches_gives_the_same_bits(grid, random_batch):
    whole = random_batch(0, frames=11)
    parts = zip(*(tensor.split(3) for tensor in whole))
    first, second = updated(KARSensitivity(grid), whole), updated(KARSensitivity(grid), *parts)
    assert_same(first.counts, second.counts)
