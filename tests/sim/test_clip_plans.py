"""The plan of a dataset, and the settings that are refused before any clip is begun."""

import math

import pandas as pd
import pytest

from src.errors import UserError
from src.sim.generate import generate
from src.sim.plan import plan_clips
from src.sim.towns import town_names
from tests.sim.weathers import WEATHERS


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"towns": ["atlantis"]}, r"sim\.towns.*atlantis.*downtown"),
        ({"towns": []}, r"sim\.towns"),
        ({"towns": ["park", "park"]}, r"sim\.towns"),
        ({"weathers": ["sunny"]}, r"sim\.weathers.*sunny.*clear"),
        ({"capture_hz": 7}, r"sim\.capture_hz: 7 .*2\.5, 5, 10"),
        ({"lidar_hz": 0}, r"sim\.lidar_hz: 0 "),
        ({"clips_per_town": 0}, r"sim\.clips_per_town: 0"),
        ({"workers": 0}, r"sim\.workers"),
        ({"seed": -1}, r"sim\.seed: -1"),
        ({"lidar_rays": 0}, r"sim\.lidar_rays: 0"),
        ({"camera_stride": 0}, r"sim\.camera_stride: 0"),
        ({"renderer": "gl"}, r"sim\.renderer.*gl.*tiny, egl"),
        ({"shards": 0}, r"sim\.shards: 0"),
        ({"shards": 4, "shard": 4}, r"sim\.shard.*4"),
        ({"shard": -1}, r"sim\.shard.*-1"),
        ({"range_m": math.nan}, r"sim\.range_m"),
        ({"range_m": 50.0}, r"grid\.upper_m.*59\.4 m.*sim\.range_m=50.*60"),
        ({"image": {"width": 96, "height": 64, "hfov_deg": 180}}, r"sim\.image\.hfov_deg"),
        ({"flight": {"ceiling": 3}}, r"sim\.flight\.ceiling.*ceiling_m"),
        ({"traffic": {"cars": 3}}, r"sim\.traffic\.cars.*counts"),
        ({"traffic": {"counts": {"tram": 1}}}, r"sim\.traffic\.counts.*tram.*bus"),
        ({"grid": {"lower_m": [0] * 3, "upper_m": [9] * 3, "shape": [3, 3, 2]}}, r"grid\.shape"),
    ],
)
def test_settings_that_cannot_be_made_are_refused_before_any_work(
    mini_sim, tmp_path, change, message
):
    with pytest.raises(UserError, match=message) as error:
        generate(mini_sim | change, tmp_path / "data")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "data").exists()


def test_the_paper_s_plan_has_every_weather_in_every_town_and_twelve_clips_of_each(mini_sim):
    mini_sim |= {"towns": town_names(), "clips_per_town": 15, "weathers": list(WEATHERS)}
    plans = plan_clips(mini_sim)
    assert len({plan.clip_id for plan in plans}) == 120
    # Ten weathers take turns over fifteen clips a town.
    matrix = pd.crosstab([plan.town for plan in plans], [plan.weather for plan in plans])
    assert matrix.shape == (8, 10)
    assert (matrix.sum() == 12).all()
    assert (matrix.sum(axis=1) == 15).all()
    assert matrix.isin([1, 2]).all(axis=None)
