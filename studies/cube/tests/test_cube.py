"""The cube: its effects by hand, and its tables from the runs of a folder."""

import shutil
from itertools import product

import pandas as pd
import pytest
import yaml
from PIL import Image

from src.errors import UserError
from studies.attitude.tests.presented import write_attitude
from studies.cube.effects import FACTORS, effects
from tests.results.scored import FACTORS as SETTINGS
from tests.results.scored import WEIGHTS, config_of, write_ladder, write_run
from tests.tasks.test_report_task import page_of, reported, table, tables

OTHERS = {
    "lovasz": ("level", None, 1.0),
    "weights_alone": ("level", WEIGHTS, 0.0),
    "attitude_lovasz": ("attitude", None, 1.0),
    "weights_lovasz": ("level", WEIGHTS, 1.0),
}
NAMES = [*SETTINGS, *OTHERS]
CORNERS = list(product((False, True), repeat=3))


def of_models(score, vertices):
    """Every effect, where models score ``score(attitude, weights, lovasz)``."""
    values = {name: score(*vertex) for vertex, name in vertices.items()}
    return {
        name: (sum(weight * values[model] for model, weight in weights.items()), comparisons)
        for name, weights, comparisons in effects(vertices)
    }


def test_effects_and_interactions_of_a_known_sum():
    def score(a, w, l):
        return 5 + 7 * a + 3 * w + 2 * a * w - 1 * a * w * l

    found = of_models(score, {corner: str(corner) for corner in CORNERS})
    attitude, weights, lovasz = FACTORS
    assert found == {
        # Of the two models that an interaction speaks of, one has it in a main effect.
        attitude: (pytest.approx(7 + 2 / 2 - 1 / 4), 4),
        weights: (pytest.approx(3 + 2 / 2 - 1 / 4), 4),
        lovasz: (pytest.approx(-1 / 4), 4),
        f"{attitude} x {weights}": (pytest.approx(2 - 1 / 2), 2),
        f"{attitude} x {lovasz}": (pytest.approx(-1 / 2), 2),
        f"{weights} x {lovasz}": (pytest.approx(-1 / 2), 2),
        f"{attitude} x {weights} x {lovasz}": (pytest.approx(-1), 1),
    }


def test_a_missing_model_takes_its_comparisons_with_it():
    ladder = {(False,) * 3: "b", (True, False, False): "a", (True, True, False): "w"}
    found = of_models(lambda a, w, l: 7 * a + 3 * w, ladder)
    assert found == {FACTORS[0]: (7, 1), FACTORS[1]: (3, 1)}


@pytest.fixture(scope="module", name="whole")
def _whole(tmp_path_factory):
    """All eight models with two seeds; not to be changed."""
    runs = write_ladder(tmp_path_factory.mktemp("cube") / "tiny", seeds=(0, 1))
    for name, (projection, weights, lovasz) in OTHERS.items():
        for seed in (0, 1):
            changes = {"model__encoder__projection": projection, "loss__class_weights": weights}
            changes |= {"loss__lovasz_weight": lovasz, "optimizer__lr": 0.001}
            write_run(runs, name, seed, **changes)
    return runs


def kar_of(runs, name):
    """The mean over seeds, in percent."""
    tables = [pd.read_csv(path) for path in sorted(runs.glob(f"{name}/seed*/results.csv"))]
    rows = pd.concat(tables).query(f"experiment == '{name}' and split == 'test'")
    return 100 * rows["kar_miou"].mean()


def test_an_effect_is_the_mean_of_its_differences(whole, tmp_path):
    out = reported(whole, out=tmp_path / "out", cube=NAMES)
    with_it = ("attitude", "weights", "attitude_lovasz", "skyocc")
    without = ("baseline", "weights_alone", "lovasz", "weights_lovasz")
    expected = sum(kar_of(whole, a) - kar_of(whole, b) for a, b in zip(with_it, without)) / 4

    shown = table(out, "cube")
    assert list(shown.index)[:3] == [*FACTORS]
    assert len(shown) == 7
    assert shown.loc[FACTORS[0], "KAR-mIoU"] == pytest.approx(expected, abs=1e-4)
    assert list(shown["models"]) == [4, 4, 4, 2, 2, 2, 1]
    assert {"Primitive miss", "Geometric IoU", "VRU"} <= {*shown.columns}
    cells = tables(out).query("table == 'cube' and column == 'KAR-mIoU'")
    assert (cells["low"] <= cells["high"]).all()
    assert cells["low"].notna().all()
    with Image.open(out / "figures/cube.png") as image:
        assert image.width > 1000
    assert "cube.png" in page_of(out)

    # Without its names there is no cube.
    reported(whole, out=out)
    assert not tables(out)["table"].str.startswith("cube").any()
    assert not (out / "figures/cube.png").exists()


def test_a_missing_model_is_told(whole, tmp_path):
    runs = shutil.copytree(whole, tmp_path / "runs/tiny")
    shutil.rmtree(runs / "weights_lovasz")
    out = reported(runs, cube=NAMES)
    assert list(table(out, "cube")["models"]) == [3, 3, 3, 1, 1, 1]
    assert "- weights_lovasz seed 1: no run" in page_of(out)


@pytest.fixture
def runs(tmp_path):
    """Three models with one seed, each scored at a weight of free."""
    runs = write_ladder(tmp_path / "runs/tiny", (0,), ("baseline", "attitude", "weights"))
    for folder in runs.glob("*/seed0"):
        (folder / "free_bias/tallies").mkdir(parents=True)
        counts = f"tallies/{folder.parent.name}.npz"
        shutil.copy(folder / counts, folder / "free_bias" / counts)
        # Of the two best ones the smaller is taken.
        curve = {"bias": [-1.0, -0.5, 0.0], "val/kar_miou": [0.3, 0.3, 0.2]}
        pd.DataFrame(curve).to_csv(folder / "free_bias/free_bias.csv", index=False)
    return runs


def test_what_was_scored_by_tilt_and_with_a_bias_has_tables(runs):
    for folder in runs.glob("*/seed0"):
        write_attitude(folder)
    out = reported(runs, cube=NAMES)
    scores = ["KAR-mIoU", "mIoU", "Car"]
    tuned, plain = (table(out, key)[scores] for key in ("cube_free_bias", "cube"))
    pd.testing.assert_frame_equal(tuned, plain)
    cells = tables(out)
    values = cells.query("table == 'free_bias' and row == 'weights'").set_index("column")["value"]
    assert values["added to free"] == "-0.5"
    assert float(values["KAR-mIoU"]) == pytest.approx(kar_of(runs, "weights"), abs=1e-4)
    assert list(table(out, "cube_tilt").index) == [FACTORS[0]]
    sampled = cells.query("table == 'sampling' and column == 'clips'")
    assert {"tilt_0_5deg, true", "tilt_5_infdeg, true"} <= set(sampled["row"])

    # With one of them gone, effects of some models alone would say something else. And of models
    # that differ in something else, nothing is said of the attitude.
    shutil.rmtree(runs / "baseline/seed0/free_bias")
    for names, is_tuned, has_tilt in ((NAMES, False, True), (["attitude", "weights"], True, False)):
        keys = set(tables(reported(runs, cube=names))["table"])
        assert "cube" in keys
        assert ("cube_free_bias" in keys, "cube_tilt" in keys) == (is_tuned, has_tilt)


def test_a_free_bias_of_other_frames_is_refused(runs, tmp_path):
    other = write_run(tmp_path / "other", "weights", 0, labels=1)
    shutil.copy(other / "tallies/weights.npz", runs / "weights/seed0/free_bias/tallies")
    with pytest.raises(UserError, match=r"weights.npz: was scored on other labels .*free_bias on"):
        reported(runs, cube=["attitude", "weights"])


def test_what_is_no_cube_is_refused(runs):
    write_run(runs, "skyocc", 0)
    write_run(runs, "twin", 0)
    write_run(runs, "wide", 0, data__batch_size=2)
    for names, message in (
        (["sky"], r"task\.cube: no finished run is of sky"),
        ([*NAMES, "twin"], "skyocc and twin have the same factors"),
        (["skyocc"], "of skyocc no two differ in one factor alone"),
        (["baseline", "wide"], r"differ in data\.batch_size: .*wide 2; leave"),
    ):
        with pytest.raises(UserError, match=message):
            reported(runs, cube=names)


def write_search(folder, name, lr, *scores):
    """A short run of a search, as far as its table reads it."""
    place = folder / f"{lr}/tiny/{name}/seed0"
    place.mkdir(parents=True)
    (place / "config.yaml").write_text(yaml.safe_dump(config_of(name, 0, optimizer__lr=lr)))
    log = "".join(f"{score}\n" for score in scores)
    (place / "metrics.csv").write_text("val/kar_miou\n" + log)
    return place


def test_the_search_shows_the_best_epoch_of_each_rate(runs, tmp_path):
    write_search(tmp_path / "search", "skyocc", 0.001, 0.1, 0.3, 0.2)
    write_search(tmp_path / "search", "skyocc", 0.002, 0.4)
    write_search(tmp_path / "search", "baseline", 0.002, 0.05)
    out = reported(runs, out=tmp_path / "out", cube=NAMES, search=[tmp_path / "search"])
    shown = table(out, "lr_search")
    assert list(shown.columns) == ["baseline", "skyocc"]
    assert shown["skyocc"].to_list() == [30, 40]
    assert shown["baseline"].isna().to_list() == [True, False]
    assert "8 epochs of 1 of the frames, seed 0" in (out / "report.md").read_text()

    twin = write_search(tmp_path / "again", "skyocc", 0.002, 0.4)
    with pytest.raises(UserError, match=r"second run of skyocc with optimizer\.lr=0\.002"):
        reported(runs, search=[tmp_path / "search", tmp_path / "again"])
    (twin / "metrics.csv").unlink()
    with pytest.raises(UserError, match=r"again/0\.002/.* has no metrics\.csv"):
        reported(runs, search=[tmp_path / "again"])
