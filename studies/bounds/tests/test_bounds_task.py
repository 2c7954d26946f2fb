"""task=bounds: floor and ceiling of a dataset."""

import shutil
from dataclasses import replace

import pandas as pd
import pytest
from PIL import Image

from src.errors import UserError
from src.results.counts import Counts
from studies.bounds.task import Sight, bounds
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture(scope="module")
def cfg(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bounds")
    cfg = compose_config(*mini_overrides(folder, "task=bounds", "data.frames=4"))
    write_dataset(cfg)
    return cfg


def measured(cfg, out, **settings):
    task = {"depth_error": [0.1], "attitude_deg": [5.0], "seed": 0, **settings}
    bounds(cfg, out=str(out), **task)
    table = pd.read_csv(out / "bounds.csv")
    return table[table["score"] == "kar_miou"].set_index("bound")


@pytest.fixture(scope="module")
def alone(cfg, tmp_path_factory):
    """The bounds, and the folder of their files."""
    out = tmp_path_factory.mktemp("alone")
    return measured(cfg, out), out


def test_floors_and_ceilings_stand_in_their_order(alone):
    table, out = alone
    floors, score = ["all_free", "voxel_prior", "height_prior"], table["value"]
    assert [*table.index[:3]] == floors
    assert set(table.index[3:]) == {
        *("images_4", "sight", "level", "depth_10%", "depth_10%_by_pixel", "depth_10%_level"),
        *("depth_10%_by_pixel_level", "attitude_5deg"),
    }
    assert score["all_free"] == 0 < score["sight"]
    assert score["depth_10%"] < score["sight"] > score["attitude_5deg"]
    assert score["sight"] > score["level"]
    assert table.loc[floors, "images"].isna().all()
    assert (table["low"] <= score).all()
    with Image.open(out / "bounds.png") as image:
        assert image.width > 600
    assert {path.stem for path in (out / "tallies").glob("*.npz")} == {*table.index}


def test_it_writes_the_same_again_and_leaves_nothing_of_an_earlier_call(
    cfg, alone, tmp_path, capsys
):
    first, out = alone
    again = measured(cfg, shutil.copytree(out, tmp_path / "out"), depth_error=[])
    assert "depth_10%" not in again.index
    pd.testing.assert_frame_equal(first.loc[again.index], again)
    shown = capsys.readouterr().out
    assert all(name in shown for name in again.index)


def trained(place, counts, log):
    (place / "tallies").mkdir(parents=True)
    shutil.copy(counts, place / "tallies")
    (place / "metrics.csv").write_text(log)
    return str(place)


LOG = "val/kar_miou,val/depth_error\n0.1,0.4\n0.3,0.2\n0.2,0.1\n"


def test_a_trained_run_stands_beside_them_by_the_depth_of_its_best_epoch(
    cfg, alone, tmp_path, capsys
):
    bounds_alone, place = alone
    run = trained(tmp_path / "run", place / "tallies/depth_10%.npz", LOG)

    # Its counts have the name of a bound, so another one tells it apart. Other scores than the
    # occupancy may have been counted with other settings.
    counts = Counts.read(tmp_path / "run/tallies/depth_10%.npz")
    suite = {**counts.protocol.suite, "tube_s": 3.0}
    mine = replace(counts, name="mine", protocol=replace(counts.protocol, suite=suite))
    mine.write(tmp_path / "run/tallies/depth_10%.npz")
    table = measured(cfg, tmp_path / "out", runs=[run])
    assert table.loc["mine", "depth_error"] == 0.2
    same = ["value", "low", "high"]
    assert (table.loc["mine", same] == bounds_alone.loc["depth_10%", same]).all()
    assert "mine" in capsys.readouterr().out
    assert not (tmp_path / "out/tallies/mine.npz").exists()
    picture = (tmp_path / "out/bounds.png").read_bytes()
    assert picture != (place / "bounds.png").read_bytes()


def test_a_run_that_cannot_stand_beside_them_is_refused_before_anything_is_scored(
    cfg, alone, tmp_path
):
    counts = alone[1] / "tallies/sight.npz"
    run = trained(tmp_path / "no_depth", counts, "val/kar_miou\n0.1\n")
    with pytest.raises(UserError, match=r"no_depth has no error of the depth; .*model/sight=on"):
        measured(cfg, tmp_path / "out", runs=[run])
    with pytest.raises(UserError, match="nowhere is neither a folder"):
        measured(cfg, tmp_path / "out", runs=["nowhere"])

    run = trained(tmp_path / "other", counts, LOG)
    mine = Counts.read(counts)
    of_other = replace(mine, protocol=replace(mine.protocol, dataset="other-1"))
    of_other.write(tmp_path / "other/tallies/sight.npz")
    with pytest.raises(UserError, match=r"dataset=other-1.*score both alike"):
        measured(cfg, tmp_path / "out", runs=[run])
    assert not (tmp_path / "out").exists()


def test_data_without_depth_are_refused_before_anything_is_written(cfg, tmp_path, monkeypatch):
    monkeypatch.setattr("studies.bounds.true_sight.AUX", "none.npz")
    with pytest.raises(UserError, match=r"/clip00: .*sim\.save_aux=true"):
        measured(cfg, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_sight_has_a_name():
    assert Sight().name == "sight"
    assert (
        Sight(4, 0.05, "pixel", 3.0, True).name == "images_4_depth_5%_by_pixel_attitude_3deg_level"
    )
