"""task=attitude on a trained checkpoint, as a user calls it."""

from pathlib import Path

import pandas as pd
import pytest

from src.errors import UserError
from src.results.counts import Counts
from src.results.files import read_results
from studies.attitude.task import attitude
from tests.synthetic import compose_config

SETTINGS = {
    "tilt_edges_deg": [6.0], "noise_deg": [20.0], "delay_s": [0.4], "distance_off": [0.5],
    "time_off_s": [0.1], "seed": 0, "level": True
}  # fmt: skip


@pytest.mark.slow
def test_it_scores_every_condition_and_the_true_one_as_the_run_did(trained, capsys):
    cfg = compose_config(*trained, "ckpt_path=best")
    attitude(cfg, **SETTINGS)
    assert "noise_20deg" in capsys.readouterr().out
    folder = f"{cfg.paths.run}/attitude"
    table = pd.read_csv(f"{folder}/attitude.csv")
    kar = table[table["score"] == "kar_miou"].set_index("condition")
    assert list(kar.index) == [
        *("true", "tilt_0_6deg", "tilt_6_infdeg", "noise_20deg", "delay_0.4s"),
        *("distance_50pct", "time_0.1s"),
        *("level", "level_tilt_0_6deg", "level_tilt_6_infdeg"),
    ]

    results = read_results(f"{cfg.paths.run}/results.csv")
    ours = results[(results["experiment"] == "skyocc") & (results["split"] == "test")].iloc[0]
    assert kar.loc["true", "value"] == pytest.approx(ours["kar_miou"], abs=1e-7)
    assert kar.loc["noise_20deg", "value"] != kar.loc["true", "value"]

    frames = kar["frames"]
    assert frames["tilt_0_6deg"] + frames["tilt_6_infdeg"] == frames["true"]
    assert frames["level_tilt_6_infdeg"] == frames["tilt_6_infdeg"]
    assert kar.loc["level_tilt_6_infdeg", "value"] != kar.loc["tilt_6_infdeg", "value"]

    counts = Counts.read(f"{folder}/tallies/noise_20deg.npz")
    assert counts.protocol.part == "test, noise_20deg"


@pytest.mark.slow
def test_nothing_of_an_earlier_call_stays(trained):
    cfg = compose_config(*trained, "ckpt_path=best")
    for edge, level in ((6.0, True), (7.0, False)):
        less = {"delay_s": [], "distance_off": [], "time_off_s": [0.1] * level}
        attitude(cfg, **{**SETTINGS, "tilt_edges_deg": [edge], "level": level, **less})
    tallies = sorted(path.stem for path in Path(cfg.paths.run).glob("attitude/tallies/*"))
    assert tallies == ["noise_20deg", "tilt_0_7deg", "tilt_7_infdeg", "true"]


@pytest.mark.slow
def test_what_cannot_be_scored_is_refused(trained):
    with pytest.raises(UserError, match="ckpt_path: task=attitude needs a checkpoint"):
        attitude(compose_config(*trained), **SETTINGS)
    with pytest.raises(UserError, match=r"task\.noise_deg"):
        attitude(compose_config(*trained, "ckpt_path=best"), **{**SETTINGS, "noise_deg": [-1.0]})
