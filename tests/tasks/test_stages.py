"""The stages of a command and their expected times."""

import pytest
from omegaconf import OmegaConf

from src.tasks.dataset import root_of
from src.tasks.stages import Stage, generation, generation_s, stages_of_training
from tests.synthetic import compose_config, mini_overrides, write_dataset


def test_a_stage_says_how_long_it_takes_as_a_range_or_that_nobody_knows():
    assert str(Stage("train", 60.0)) == "train: 60 s to 2.5 min"
    assert str(Stage("train", None)) == "train: the bar will tell how long it takes"
    assert str(Stage("generate", 0.0)) == "generate: done before"


def test_a_training_tells_its_frames_and_what_is_there_already(tmp_path):
    cfg = compose_config(*mini_overrides(tmp_path, "trainer.accelerator=cpu"))
    ahead = stages_of_training(cfg, epochs_done=0)
    assert [stage.what.split()[0] for stage in ahead] == ["generate", "train", "score", "draw"]
    # Of two flights one is held out, and 25 frames of the other are for training.
    assert "2 flights of 12 s" in ahead[0].what
    assert "train 2 epochs of 25 frames" in ahead[1].what
    assert "score 32 frames" in ahead[2].what
    assert all(stage.seconds > 0 for stage in ahead)

    write_dataset(cfg)
    assert generation(cfg).seconds == 0
    assert stages_of_training(cfg, epochs_done=1)[1].seconds == ahead[1].seconds / 2
    (root_of(cfg) / "suburb/clip00").rename(tmp_path / "gone")
    assert generation(cfg).seconds > 0


def test_of_other_scales_and_devices_no_time_is_told(tmp_path, monkeypatch):
    words = mini_overrides(tmp_path, "trainer.accelerator=cpu")
    assert stages_of_training(compose_config(*words, "scale_name=huge"), 0)[1].seconds is None
    monkeypatch.setattr("src.tasks.trainer.kind_of_device", lambda accelerator: "cuda")
    assert stages_of_training(compose_config(*words), 0)[1].seconds is None


@pytest.mark.parametrize(("limit", "frames"), [(0.5, "12"), (2, "16"), (1.0, "25")])
def test_a_limited_training_counts_its_own_frames(tmp_path, limit, frames):
    words = mini_overrides(tmp_path, f"+trainer.limit_train_batches={limit}")
    assert f" of {frames} frames" in stages_of_training(compose_config(*words), 0)[1].what


def test_a_training_of_one_thread_takes_the_time_of_one_core(tmp_path, monkeypatch):
    monkeypatch.setattr("src.tasks.stages.default_workers", lambda: 4)
    words = mini_overrides(tmp_path, "trainer.accelerator=cpu")
    of_all, of_one = (
        stages_of_training(compose_config(*words, f"threads={threads}"), 0)[1].seconds
        for threads in ("null", 1)
    )
    assert of_one == pytest.approx(4 * of_all)


def test_more_workers_generate_faster_until_there_are_more_than_flights(tmp_path):
    sim = OmegaConf.to_container(compose_config(*mini_overrides(tmp_path)).sim, resolve=True)
    one, two, four = (generation_s(sim | {"workers": n}, clips=2) for n in (1, 2, 4))
    assert two == pytest.approx(one / 2)
    assert four == two
