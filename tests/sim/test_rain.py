"""Streaks of rain."""

from dataclasses import replace

import numpy as np

from src.sim.rain import STREAK_COLOR, draw_rain
from tests.sim.weathers import WEATHERS

HEIGHT, WIDTH = 64, 96
RAIN = replace(WEATHERS["rain"], rain=4.0, exposure=(1.0, 1.0, 1.0))


def rained(weather, seed=0, height=HEIGHT, width=WIDTH, value=0.0):
    image = np.full((height, width, 3), value, dtype=np.float32)
    draw_rain(image, weather, np.random.default_rng(seed))
    return image


def test_rain_draws_streaks_and_more_rain_draws_more():
    share = [(rained(replace(RAIN, rain=rain)) > 0).any(axis=-1).mean() for rain in (0, 1, 4, 14)]
    assert share[0] == 0
    assert 0.01 < share[2] < 0.3
    assert share[1] < 0.5 * share[2] < share[2] < 0.5 * share[3]


def test_streaks_only_come_nearer_to_their_color_and_the_night_dims_it():
    color = np.array(STREAK_COLOR, dtype=np.float32)
    day = rained(RAIN)
    dark = rained(replace(RAIN, exposure=(0.1, 0.2, 0.3)))
    assert (day <= color).all()
    np.testing.assert_allclose(dark, 0.3 * day, atol=1e-6)
    same = np.full((HEIGHT, WIDTH, 3), color)
    draw_rain(same, RAIN, np.random.default_rng(0))
    np.testing.assert_allclose(same, np.broadcast_to(color, same.shape), atol=1e-6)
    assert (rained(RAIN, value=1.0) <= 1).all()
    assert (rained(RAIN, value=1.0) < 1).any()
