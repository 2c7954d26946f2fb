"""What the rungs share: a training whose pixels are a second task."""

import re
from pathlib import Path

import pandas as pd
import pytest
from hydra.errors import InstantiationException

from src.data.clip import AUX
from src.data.volumes import FOLDER
from src.errors import UserError
from src.failures import one_line
from src.tasks.dataset import root_of
from src.tasks.fit import fit
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture
def config(tmp_path):
    def composed(*overrides):
        own = ("+experiment=skyocc", "trainer.max_epochs=2", *overrides)
        return compose_config(*mini_overrides(tmp_path, *own))

    write_dataset(composed())
    return composed


@pytest.mark.slow
def test_what_pixels_see_is_learnt_measured_and_scored_beside_its_floor(config):
    cfg = config("trainer.max_epochs=4")
    assert fit(cfg) == "finished"
    log = pd.read_csv(f"{cfg.paths.run}/metrics.csv")
    for loss in ("train/pixel_class", "train/pixel_depth"):
        of_epochs = log.groupby("epoch")[loss].mean()  # of single batches, which differ
        assert of_epochs.iloc[-1] < of_epochs.iloc[0]
    assert log["val/depth_error"].dropna().between(0, 3).sum() == 4
    results = pd.read_csv(f"{cfg.paths.run}/results.csv")
    assert {"skyocc", "height_prior"} <= {*results["experiment"]}


def test_data_without_depth_are_refused_with_both_ways_out(config):
    (root_of(config()) / "downtown/clip00" / AUX).unlink()
    with pytest.raises(UserError, match=r"^model/sight: .*sim\.save_aux=true.*model/sight=off"):
        fit(config())
    assert not Path(config().paths.run).exists()


def test_a_second_task_without_its_labels_is_refused_before_it_trains(config):
    with pytest.raises(UserError, match=r"^data\.pixels: .*model/sight"):
        fit(config("data.pixels=false"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("model/sight=off", "model/parallax: on, and model/sight=off"),
        ("model/parallax=off model/sight=off", "model/evidence: on reads .*model/sight=on"),
        ("data.parallax.bins=24", "data.parallax.bins: 24, .* has 48"),
        ("data.parallax.ages_s=[0.3]", r"data.parallax.ages_s: \[0.3\]"),
        ("data.parallax.ages_s=[]", r"data.parallax.ages_s: \[\]"),
    ],
)
def test_what_nobody_could_read_is_refused_before_it_trains(config, words, message):
    with pytest.raises((UserError, InstantiationException)) as refused:
        fit(config(*words.split()))
    assert re.match(message, one_line(refused.value))


@pytest.mark.slow
def test_parallax_is_kept_beside_the_data_and_taught(config):
    cfg = config("trainer.max_epochs=1")
    assert fit(cfg) == "finished"
    kept = [*(root_of(cfg) / FOLDER).rglob("*.npy")]
    assert len(kept) == cfg.sim.clips_per_town * len(cfg.sim.towns)
