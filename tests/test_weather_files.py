"""A weather of one's own is a file, found by its name; what it holds is part of the data."""

import pytest
from omegaconf import OmegaConf

from src.data.manifest import DatasetSpec, require_same_data, write_manifest
from src.dotted import differences
from src.errors import UserError
from src.sim.plan import plan_clips
from src.sim.weather import Weather
from src.tasks.dataset import spec_of
from tests.sim.weathers import WEATHERS
from tests.synthetic import compose_config, sound_config

DUST = "defaults: [cloudy, _self_]\nfog_per_m: 0.03\n"


@pytest.fixture
def composed(tmp_path):
    """Composes a configuration beside a folder with a weather of one's own."""
    (tmp_path / "sim/weather").mkdir(parents=True)
    (tmp_path / "sim/weather/dust.yaml").write_text(DUST)

    def composed_with(override):
        cfg = sound_config(override, folder=tmp_path)
        return OmegaConf.to_container(cfg.sim, resolve=True)

    return composed_with


def test_a_file_is_found_by_its_name(composed):
    sim = composed("sim.weathers=[clear,dust]")
    assert {plan.weather for plan in plan_clips(sim)} == {"clear", "dust"}
    dust = Weather.of(sim, "dust")
    assert (dust.fog_per_m, dust.ambient) == (0.03, WEATHERS["cloudy"].ambient)


@pytest.mark.parametrize("name", ["dusk", "no name", "3"])
def test_a_name_without_a_file_is_answered_with_those_that_there_are(composed, name):
    sim = composed(f"sim.weathers=[clear,'{name}']")
    with pytest.raises(UserError, match=rf"^sim\.weathers.*{name}.*clear, cloudy"):
        plan_clips(sim)


def test_only_the_values_of_weathers_in_use_shape_the_data():
    changes = ("sim.weather.rain.rain=4.0", "sim.weather.rain.rain=5.0", "sim.weather.fog.rain=1.0")
    spec, other, same = (spec_of(compose_config("scale=tiny", change)) for change in changes)
    assert set(spec.sim["weather"]) == {"clear", "cloudy", "rain"}
    assert spec.digest == same.digest != other.digest
    assert [*differences(spec.sim, other.sim)] == [("weather.rain.rain", 4, 5)]


def test_older_data_whose_manifest_names_its_weathers_alone_may_be_used(tmp_path):
    spec = spec_of(compose_config("scale=tiny"))
    older = {key: value for key, value in spec.sim.items() if key != "weather"}
    write_manifest(
        tmp_path, DatasetSpec("tiny", older, "older"), [], {"train": [], "val": [], "test": []}
    )
    require_same_data(tmp_path, spec)
    other = spec_of(compose_config("scale=tiny", "sim.weathers=[fog]"))
    with pytest.raises(UserError, match=r"sim\.weathers"):
        require_same_data(tmp_path, other)
