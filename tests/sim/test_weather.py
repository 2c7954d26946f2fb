"""What a weather does to a picture."""

from dataclasses import replace

import numpy as np
import pytest

from src.errors import UserError
from src.sim.weather import WEATHERS, apply_weather, weather_named

PLAIN = replace(
    WEATHERS["clear"], fog_per_m=0.0, noise_std=0.0, rain=0.0, wetness=0.0, exposure=(1, 1, 1)
)
GREY = np.full((64, 96, 3), 100, dtype=np.uint8)
LEVEL = np.zeros((64, 96))


def painted(weather, depth_m=10.0, rgb=GREY, elevation=LEVEL, seed=0):
    depth_m = np.broadcast_to(np.float32(depth_m), rgb.shape[:2])
    return apply_weather(rgb, depth_m, elevation, weather, np.random.default_rng(seed))


def test_weather_without_weather_leaves_the_picture():
    assert (painted(PLAIN) == GREY).all()


def test_fog_follows_beer_lambert():
    foggy = replace(PLAIN, fog_per_m=0.03, fog_color=(0.8, 0.7, 0.6))
    for depth_m in (1.0, 20.0, 60.0):
        left = np.exp(-0.03 * depth_m)
        expected = 100 * left + 255 * np.array([0.8, 0.7, 0.6]) * (1 - left)
        assert painted(foggy, depth_m)[0, 0] == pytest.approx(expected, abs=0.51)


def test_fog_hides_the_horizon_and_thins_upwards():
    foggy = replace(PLAIN, fog_per_m=0.01, fog_color=(1.0, 0.0, 0.0))
    red = [painted(foggy, np.inf, elevation=np.full((64, 96), z))[0, 0, 0] for z in (0.02, 0.5, 1)]
    assert red[0] > 250 > red[1] > red[2] > painted(PLAIN, np.inf, elevation=LEVEL + 1)[0, 0, 0]


def test_the_sky_is_where_nothing_is_and_nowhere_else():
    depth_m = np.full((64, 96), 10.0)
    depth_m[:20] = np.inf
    elevation = np.linspace(1, -1, 64)[:, None] * np.ones((1, 96))
    image = painted(PLAIN, depth_m, elevation=elevation)
    assert (image[20:] == 100).all()
    assert image[0, 0] == pytest.approx(255 * np.array(PLAIN.sky_zenith), abs=1)
    below = painted(PLAIN, np.inf, elevation=np.full((64, 96), -0.3))
    assert below[0, 0] == pytest.approx(255 * np.array(PLAIN.sky_horizon), abs=1)


def test_rain_draws_streaks_and_noise_is_noise():
    changed = (painted(replace(PLAIN, rain=4.0)) != GREY).any(axis=-1)
    assert 0.01 < changed.mean() < 0.3
    noisy = painted(replace(PLAIN, noise_std=0.02)).astype(float)
    assert noisy.std() == pytest.approx(0.02 * 255, rel=0.1)


def test_wet_things_and_the_night_are_darker():
    assert painted(replace(PLAIN, wetness=0.2)).mean() == pytest.approx(80, abs=0.51)
    assert painted(WEATHERS["night"]).mean() < 0.5 * painted(WEATHERS["clear"]).mean()


def test_the_same_generator_gives_the_same_bytes():
    heavy = WEATHERS["heavy_rain"]
    assert (painted(heavy) == painted(heavy)).all()
    assert (painted(heavy) != painted(heavy, seed=1)).any()


def test_all_weathers_differ_and_keep_the_size():
    rgb = np.random.default_rng(0).integers(0, 256, GREY.shape, dtype=np.uint8)
    images = {name: painted(weather, rgb=rgb) for name, weather in WEATHERS.items()}
    assert all(image.shape == rgb.shape and image.dtype == np.uint8 for image in images.values())
    assert len({image.tobytes() for image in images.values()}) == len(WEATHERS) >= 6


def test_the_light_is_a_unit_vector_from_above_and_says_everything():
    keys = {"lightDirection", "lightColor", "shadow"}
    keys |= {f"light{kind}Coeff" for kind in ("Ambient", "Diffuse", "Specular")}
    for weather in WEATHERS.values():
        light = weather.light()
        assert set(light) == keys
        assert np.linalg.norm(light["lightDirection"]) == pytest.approx(1)
        assert light["lightDirection"][2] > 0


def test_an_unknown_weather_is_answered_with_the_known_ones():
    with pytest.raises(UserError, match=r"hail.*clear.*night"):
        weather_named("hail")
