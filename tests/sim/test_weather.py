"""Light and weather as plain data."""

from dataclasses import replace

import numpy as np
import pytest

from src.errors import UserError
from src.sim.weather import WEATHERS, weather_named


def test_the_light_is_a_unit_vector_from_above_and_says_everything():
    keys = {"lightDirection", "lightColor", "shadow"}
    keys |= {f"light{kind}Coeff" for kind in ("Ambient", "Diffuse", "Specular")}
    for weather in WEATHERS.values():
        light = weather.light()
        assert set(light) == keys
        assert light["lightDirection"] == list(weather.towards)
        assert np.linalg.norm(light["lightDirection"]) == pytest.approx(1)
        assert light["lightDirection"][2] > 0


def test_the_light_is_where_its_angles_say():
    north = replace(WEATHERS["clear"], light_elevation_rad=0.0, light_azimuth_rad=np.pi / 2)
    assert north.towards == pytest.approx((0, 1, 0))
    assert replace(north, light_azimuth_rad=0.0).towards == pytest.approx((1, 0, 0))
    assert replace(north, light_elevation_rad=np.pi / 2).towards == pytest.approx((0, 0, 1))
    assert replace(north, light_elevation_rad=np.pi / 6).towards[2] == pytest.approx(0.5)


def test_there_are_ten_weathers_and_all_differ():
    assert len(WEATHERS) == len(set(WEATHERS.values())) == 10
    assert all(weather_named(name) is weather for name, weather in WEATHERS.items())


def test_an_unknown_weather_is_answered_with_the_known_ones():
    with pytest.raises(UserError, match=r"hail.*clear.*night"):
        weather_named("hail")
