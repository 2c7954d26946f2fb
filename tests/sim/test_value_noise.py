"""Random fields: smooth, bounded, and the same for ever."""

import numpy as np
import pytest

from src.sim.value_noise import value_noise

PLACES = np.random.default_rng(0).uniform(-40, 40, (3000, 2))
PINNED = [0.1463782, 0.6597657, 0.5165171]


def field(places, octaves):
    return np.array([value_noise(x, y, octaves) for x, y in places.tolist()])


def test_a_place_has_its_value_for_ever():
    pinned = [value_noise(*place) for place in ((0.25, 0.5, 1), (-3.7, 12.1, 2), (88.8, -0.4, 3))]
    assert pinned == pytest.approx(PINNED, abs=1e-6)


@pytest.mark.parametrize("octaves", [1, 2, 3])
def test_values_fill_the_unit_interval_about_a_half(octaves):
    values = field(PLACES, octaves)
    assert 0 <= values.min() < 0.2
    assert 0.8 < values.max() <= 1
    assert values.mean() == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("octaves", [1, 2, 3])
def test_a_small_step_is_a_small_change(octaves):
    # A blend's steepest slope is 1.5, and every octave is as steep as the first.
    steepest = 1.5 * octaves / sum(0.5**k for k in range(octaves))
    on_lines = np.concatenate([np.round(PLACES), np.round(PLACES * [1, 0.1]) * [0.5, 1]])
    places = np.concatenate([PLACES, on_lines])
    for step in ([1e-3, 0], [0, 1e-3]):
        change = field(places + step, octaves) - field(places - step, octaves)
        assert np.abs(change).max() < 1.05 * steepest * 2e-3
