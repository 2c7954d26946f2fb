"""Light and weather as plain data."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from omegaconf import OmegaConf

from src.errors import UserError
from src.sim.weather import Weather
from tests.sim.weathers import VALUES, WEATHERS
from tests.synthetic import compose_config

MISSING = object()


def test_the_light_is_where_its_angles_say():
    north = replace(WEATHERS["clear"], light_elevation_rad=0.0, light_azimuth_rad=np.pi / 2)
    assert north.towards == pytest.approx((0, 1, 0))
    assert replace(north, light_azimuth_rad=0.0).towards == pytest.approx((1, 0, 0))
    assert replace(north, light_elevation_rad=np.pi / 2).towards == pytest.approx((0, 0, 1))
    assert replace(north, light_elevation_rad=np.pi / 6).towards[2] == pytest.approx(0.5)


def test_every_value_of_a_weather_is_composed_and_can_be_overridden():
    sim = OmegaConf.to_container(compose_config("sim.weather.fog.fog_per_m=0.08").sim, resolve=True)
    assert set(sim["weathers"]) == set(WEATHERS)
    settings = {field.name for field in fields(Weather)}
    assert all(set(sim["weather"][name]) == settings for name in WEATHERS)
    assert Weather.of(sim, "rain") == WEATHERS["rain"]
    assert Weather.of(sim, "fog") == replace(WEATHERS["fog"], fog_per_m=0.08)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rain": MISSING}, r"rain: "),
        ({"fogg_per_m": 1.0}, r"fogg_per_m.*'fog_per_m'\?.*rain"),
        ({"rain": "much"}, r"rain: 'much'.*0 to 1000"),
        ({"rain": -1}, r"rain: -1 "),
        ({"rain": math.nan}, r"rain: nan "),
        ({"rain": True}, r"rain: True "),
        ({"shadow": 1}, r"shadow: 1 "),
        ({"ambient": 0}, r"ambient: 0 "),
        ({"light_elevation_rad": 2.0}, r"light_elevation_rad: 2\.0 "),
        ({"glow": 0.5}, r"glow: 0\.5 .*red"),
        ({"glow": [0.5, 0.5]}, r"glow: \[0\.5, 0\.5\] "),
        ({"glow": [0.5, 0.5, 128]}, r"glow: 128 "),
    ],
)
def test_a_weather_that_cannot_be_made_is_refused_by_its_key(change, message):
    values = VALUES["clear"] | change
    given = {name: value for name, value in values.items() if value is not MISSING}
    with pytest.raises(UserError, match=rf"^sim\.weather\.mine\.{message}"):
        Weather.of({"weather": {"mine": given}}, "mine")
