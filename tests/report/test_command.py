"""The command on the card names the dataset that it stands on."""

import pytest
from omegaconf import OmegaConf

from src.data.dataset import history_stride
from src.data.manifest import read_manifest
from src.report.command import overrides_of
from src.tasks.dataset import spec_of
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.mark.parametrize(
    "settings",
    [
        ["sim.seed=7", "sim.weathers=[fog,night]"],
        ["sim.save_aux=true", "+sim.flight.min_altitude_m=3.5", "sim.camera.pitch_deg=10.0"],
        ["grid.shape=[50,50,30]", "sim.image.width=128", "sim.workers=1"],
    ],
)
def test_it_composes_to_the_same_digest(tmp_path, settings):
    made_with = compose_config(*mini_overrides(tmp_path, *settings))
    manifest = read_manifest(write_dataset(made_with))
    words = overrides_of(manifest)
    cfg = compose_config(*words)
    assert spec_of(cfg).digest == spec_of(made_with).digest
    assert (cfg.scale_name, cfg.data.test_clips) == ("tiny", ["suburb/clip00"])
    assert OmegaConf.to_container(cfg.grid) == OmegaConf.to_container(made_with.grid)
    assert any(setting in words for setting in settings if not setting.startswith("+"))


def test_it_is_not_refused_for_its_capture_rate(tmp_path):
    cfg = compose_config(*mini_overrides(tmp_path))
    composed = compose_config(*overrides_of(read_manifest(write_dataset(cfg))))
    assert history_stride(composed.data.history_step_s, composed.sim.capture_hz) == 1
