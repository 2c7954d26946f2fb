"""KARSensitivity: every setting is a KARMeanIoU of its own."""

from itertools import product

import pytest

from src.errors import UserError
from src.metrics import KARMeanIoU
from studies.sensitivity.metric import GRID, PARAMETERS, KARSensitivity
from tests.metrics.inputs import FOUR_CLASSES, assert_same, scores_of, updated

FEW = {"horizon_s": (1.5, 5.0), "penalty_scale": (0.0, 2.0, 7.0)}


def check(grid, *batches, values=GRID):
    metric = KARSensitivity(grid, values)
    actual = list(scores_of(metric, *batches).values())
    expected = [
        float(updated(KARMeanIoU(grid, **setting), *batches).compute())
        for setting in metric.settings.to_dict("records")
    ]
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return actual


def test_every_setting_is_kar_miou_with_these_parameters(grid, random_batch):
    actual = check(grid, random_batch(0), random_batch(1))
    assert len(actual) == 81
    assert len(set(actual)) > 50


@pytest.mark.parametrize("seed", range(3))
def test_random_batches_and_other_values(grid, random_batch, seed):
    actual = check(grid, random_batch(seed), values=FEW)
    assert actual[0] > actual[1] > actual[2]


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


def test_other_classes_free_and_unknown_labels(grid, four_classes):
    sensitivity = KARSensitivity(grid, {"penalty_scale": (3.0,)}, **FOUR_CLASSES)
    metric = updated(sensitivity, four_classes)
    kar = updated(KARMeanIoU(grid, penalty_scale=3.0, **FOUR_CLASSES), four_classes)
    assert float(*metric.compute().values()) == pytest.approx(float(kar.compute()), abs=1e-6)


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


def test_any_split_into_batches_gives_the_same_bits(grid, random_batch):
    whole = random_batch(0, frames=11)
    parts = zip(*(tensor.split(3) for tensor in whole))
    first, second = updated(KARSensitivity(grid), whole), updated(KARSensitivity(grid), *parts)
    assert_same(first.counts, second.counts)
