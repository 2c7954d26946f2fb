"""The color of the sky in a direction."""

from dataclasses import replace

import numpy as np
import pytest

from src.sim.sky import Sky, sky_at
from tests.sim.weathers import WEATHERS

BARE = replace(WEATHERS["clear"], fog_per_m=0.0, cloud_cover=0.0, glow=(0.0, 0.0, 0.0))
RNG = np.random.default_rng(0)
UP = RNG.normal(size=(1000, 3)) * [1, 1, 0.5]
UP = np.abs(UP / np.linalg.norm(UP, axis=1, keepdims=True))
UP[:, :2] *= RNG.choice([-1, 1], (1000, 2))
DOWN = UP * [1, 1, -1]


def sky(weather, directions):
    colors = Sky.of(weather)
    return np.array([sky_at(x, y, z, colors) for x, y, z in np.reshape(directions, (-1, 3))])


def level(z, azimuth=0.5):
    """The unit vector of a rise."""
    flat = np.sqrt(1 - z * z)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), z])


def test_the_sky_goes_from_the_horizon_up_to_the_zenith_by_the_rise_alone():
    horizon, zenith = np.array(BARE.sky_horizon), np.array(BARE.sky_zenith)
    everywhere = np.concatenate([UP, DOWN])
    expected = horizon + (zenith - horizon) * np.sqrt(np.maximum(everywhere[:, 2:], 0))
    assert sky(BARE, everywhere) == pytest.approx(expected, abs=1e-6)


def test_clouds_are_only_above_the_horizon():
    cloudy = replace(BARE, cloud_cover=0.9, cloud_color=(1.0, 0.0, 0.0))
    assert (sky(cloudy, DOWN) == sky(BARE, DOWN)).all()
    near = np.array([level(1e-3, azimuth) for azimuth in np.linspace(0, 6, 50)])
    assert sky(cloudy, near) == pytest.approx(sky(BARE, near), abs=0.02)
    assert (np.abs(sky(cloudy, UP) - sky(BARE, UP)).max(axis=1) > 0.2).mean() > 0.5


def test_clouds_are_patches_and_every_sun_has_its_own():
    cloudy = replace(BARE, cloud_cover=0.5, cloud_color=(1.0, 0.0, 0.0))
    beside = [level(0.6, azimuth) for azimuth in np.arange(0, 6, 0.01)]
    red = sky(cloudy, beside)[:, 0]
    assert red.max() - red.min() > 0.3
    assert np.abs(np.diff(red)).max() < 0.1
    other = sky(replace(cloudy, light_azimuth_rad=2.0), beside)[:, 0]
    assert np.abs(other - red).max() > 0.3


def test_the_sky_glows_around_the_sun():
    sunny = replace(BARE, glow=(0.5, 0.3, 0.1), light_elevation_rad=0.3)
    towards = np.array(sunny.towards)
    extra = sky(sunny, UP) - sky(BARE, UP)
    order = np.argsort(UP @ towards)
    assert (np.diff(extra[order, 0]) > -1e-6).all()
    most = sky(sunny, towards) - sky(BARE, towards)
    assert most[0] == pytest.approx(sunny.glow, abs=1e-5)
    assert extra[UP @ towards < 0].max() < 1e-3
