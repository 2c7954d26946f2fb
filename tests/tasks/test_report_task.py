"""task=report as its user meets it: what it writes, prints, and refuses."""

import re
import shutil

import numpy as np
import pandas as pd
import pytest
from hydra.utils import instantiate
from PIL import Image

from src.errors import UserError
from src.report.section import Section
from src.results.render import Cell, Table
from tests.results.scored import write_ladder, write_run
from tests.synthetic import compose_config

KEYS = ("main", "ablation", "long_tail", "incremental", "progression", "beyond", "sampling")
FACTS = 2
"""So many tables say what the numbers of a ladder rest on."""
OF_PARTS = ("main", "ablation", "beyond")
UNTRAINED = ("All free", "Voxel prior", "Height prior")


@pytest.fixture(scope="module")
def ladder(tmp_path_factory):
    """A finished ladder of three seeds; not to be changed."""
    return write_ladder(tmp_path_factory.mktemp("runs") / "tiny")


@pytest.fixture
def runs(ladder, tmp_path):
    """A copy of the ladder that a test may change."""
    return shutil.copytree(ladder, tmp_path / "runs/tiny")


def reported(runs, *places, out=None, **settings):
    """The folder of the report on a scale's runs, whose networks do not exist."""
    cfg = compose_config("task=report", "scale=tiny", f"paths.runs={runs.parent}")
    settings = {"scenes": 0, "runs": list(map(str, places)), **settings}
    settings |= {"out": str(out)} if out else {}
    instantiate(cfg.task, **settings)(cfg)
    return out or runs.parent / "tiny/report"


def page_of(out):
    """``report.md`` without the backslashes before underscores."""
    return (out / "report.md").read_text().replace("\\_", "_")


def section_of(out, heading):
    return page_of(out).split(f"## {heading}")[1].split("## ")[0]


def tables(out):
    return pd.read_csv(out / "tables.csv", float_precision="round_trip")


def table(out, key):
    """Values of a table, its rows and columns in their order."""
    cells = tables(out).query("table == @key")
    wide = cells.pivot(index="row", columns="column", values="value")
    wide = wide.reindex(index=cells["row"].unique(), columns=cells["column"].unique())
    return wide.apply(pd.to_numeric, errors="coerce")


# -------------------------------------------------------------------------------- what it leaves


def test_a_ladder_leaves_every_table_in_every_form(ladder, tmp_path, capsys):
    out = reported(ladder, out=tmp_path / "out")
    expected = [*KEYS]
    for part in ("test_unseen_clips", "test_seen_clips"):
        expected += [f"{key}_{part}" for key in OF_PARTS]
    assert set(tables(out)["table"]) == set(expected)
    assert {path.name for path in out.iterdir()} == {
        *("tables.csv", "tables.tex", "scores.csv", "report.md", "report.html")
    }

    page, latex = page_of(out), (out / "tables.tex").read_text()
    assert page.count("| --: |\n") == len(expected) + FACTS
    assert all(f"\\label{{tab:{key}}}" in latex for key in expected)
    assert "## Missing" not in page
    assert "Not a clean comparison" not in page
    assert "| Runs, seeds | baseline (0, 1, 2); attitude (0, 1, 2); weights (0, 1, 2);" in page
    assert "| optimizer.lr | 0.002 |" in page
    assert "| model.encoder.projection | level | attitude | attitude | attitude |" in page

    said = capsys.readouterr().out
    assert max(map(len, said.splitlines()[:-1])) <= 110
    for words in ("Main results, test", "Ablation study, test", "SkyOcc"):
        assert words in said
    assert said.splitlines()[-1] == f"open {out}/report.html"


def test_runs_may_be_named_and_nothing_else_is_then_taken(ladder, tmp_path):
    named = (ladder / "baseline", ladder / "skyocc/seed1")
    out = reported(ladder, *named, out=tmp_path / "out")
    assert list(table(out, "ablation").index) == ["Baseline", "SkyOcc"]
    assert set(table(out, "main").index) == {"Baseline", "SkyOcc", *UNTRAINED}


def test_a_report_in_its_default_place_is_no_run_of_the_next_one(runs):
    out = reported(runs)
    page = page_of(out)
    write_run(out, "skyocc", 7)  # whatever lies there
    assert page_of(reported(runs)) == page


def test_the_page_has_the_tables_and_the_curves_of_the_runs_that_have_a_log(runs):
    for seed in (0, 1):
        log = "step,epoch,train/total,val/miou,val/kar_miou\n9,0,2.5,,\n9,0,,0.125,0.25\n"
        (runs / f"skyocc/seed{seed}/metrics.csv").write_text(log)
    page = (reported(runs) / "report.html").read_text()
    for words in ("Main results, test", "KAR-mIoU on validation", "%{y:.1f} % ("):
        assert words in page
    assert "<th>model.encoder.projection</th><td>level</td>" in page


def test_the_recipe_is_named_once_where_runs_share_it_and_else_in_every_row(runs):
    """Also beside runs from before there were recipes, whose counts name none."""
    out = reported(runs)
    assert "**Main results, test of tiny-0123; recipe strong.**" in page_of(out)
    assert "| Recipe | strong |" in page_of(out)
    assert "; recipe strong." in (out / "tables.tex").read_text()
    cells = tables(out).query("table == 'main'").set_index("row")["recipe"]
    assert (set(cells["SkyOcc"]), set(cells["All free"])) == ({"strong"}, {"none"})
    scores = pd.read_csv(out / "scores.csv").groupby("experiment")["recipe"].agg(set)
    assert (scores["skyocc"], scores["voxel_prior"]) == ({"strong"}, {"none"})

    write_run(runs, "bare", 0, recipe="paper")
    older = shutil.copytree(runs / "bare/seed0", runs / "older/seed0")
    text = (older / "config.yaml").read_text().replace("name: bare", "name: older")
    (older / "config.yaml").write_text(text)
    rows = pd.read_csv(older / "results.csv", dtype=str, keep_default_na=False)
    rows.drop(columns="recipe").replace("bare", "older").to_csv(older / "results.csv", index=False)
    with np.load(older / "tallies/bare.npz") as arrays:
        kept = {key: array for key, array in arrays.items() if key != "recipe"}
    np.savez(older / "tallies/older.npz", **kept)

    out = reported(runs)
    cells = tables(out).query("table == 'main' and column == 'Recipe'").set_index("row")["value"]
    assert cells[["SkyOcc", "bare", "older", "All free"]].tolist() == [
        *("strong", "paper", "unknown", "none")
    ]
    assert "| Recipe | strong (baseline, attitude, weights, skyocc); paper (bare);" in page_of(out)


def counted_section(reported, unit="runs"):
    """A section of one's own: how many runs there are."""
    rows = [("all", [Cell(len(reported.runs))])]
    return Section([Table("counted", "Counted", "", [unit], rows)], pictures={"mine.png": dot})


def dot(path, frames):
    Image.new("RGB", (8, 8)).save(path)
    return "Mine"


def test_a_section_of_ones_own_adds_its_table_and_reads_its_settings(ladder, tmp_path):
    mine = {"mine": {"_target_": f"{__name__}.counted_section", "_partial_": True}}
    (tmp_path / "out/figures").mkdir(parents=True)
    out = reported(ladder, out=tmp_path / "out", sections=mine, unit="trainings")
    assert table(out, "counted").loc["all", "trainings"] == 12
    assert "![Mine](figures/mine.png)" in page_of(out)
    with pytest.raises(UserError, match=r"^task\.units: nothing reads .* mean 'unit'"):
        reported(ladder, out=tmp_path / "other", sections=mine, units="trainings")
    assert not (tmp_path / "other").exists()


def test_a_setting_beside_the_factors_stands_before_the_tables_and_is_printed(runs, capsys):
    for seed in range(3):
        path = runs / f"skyocc/seed{seed}/config.yaml"
        path.write_text(path.read_text().replace("lr: 0.002", "lr: 0.01"))
    page = page_of(reported(runs))
    row = "| optimizer.lr | 0.002 | 0.002 | 0.002 | 0.01 |"
    assert page.index("Not a clean comparison") < page.index(row) < page.index("## Facts")
    line = " ".join(capsys.readouterr().out.split())
    assert "Not a clean comparison: optimizer.lr (baseline 0.002; attitude 0.002; " in line


# -------------------------------------------------------------------------------- what is missing


def test_an_own_ladder_is_reported_as_the_papers_is(runs):
    for seed in range(3):
        path = write_run(runs, "mine", seed, optimizer__lr=0.01) / "results.csv"
        rows = pd.read_csv(path, dtype=str, keep_default_na=False)
        rows.assign(parameters="12000").to_csv(path, index=False)
    out = reported(runs, rungs=["baseline", "skyocc", "mine"])
    assert table(out, "ablation").index.tolist() == ["Baseline", "SkyOcc", "mine"]
    page = page_of(out)
    assert re.search(r"\| Parameters \| 10 \(baseline, skyocc.*\); 12,000 \(mine\) \|", page)
    assert "Not a clean comparison" not in page


def test_without_data_set_or_checkpoints_it_says_so_and_has_no_scenes(runs, capsys):
    out = reported(runs, scenes=2)
    for told in (page_of(out), (out / "report.html").read_text(), capsys.readouterr().out):
        assert "no pictures and no scenes: " in told
    assert not list(out.rglob("*.png"))


def test_an_interrupted_sweep_says_what_is_missing_and_reports_the_rest(runs, capsys):
    shutil.rmtree(runs / "skyocc/seed2")
    (runs / "weights/seed1/results.csv").unlink()
    (runs / "weights/seed1/metrics.csv").write_text("step,epoch\n9,2\n")
    out = reported(runs)
    assert [line for line in section_of(out, "Missing").splitlines() if line] == [
        "- weights seed 1: unfinished, 3 of 8 epochs logged",
        "- skyocc seed 2: no run",
    ]
    assert "weights seed 1: unfinished, 3 of 8 epochs logged" in capsys.readouterr().out


def test_seeds_that_have_not_begun_are_missing_where_the_sweep_is_known(ladder, tmp_path):
    out = reported(ladder, out=tmp_path / "out", seeds=range(4))
    assert section_of(out, "Missing").split("\n")[2:6] == [
        f"- {rung} seed 3: no run" for rung in ("baseline", "attitude", "weights", "skyocc")
    ]


def test_without_any_rung_there_is_the_main_table_alone(tmp_path):
    runs = tmp_path / "runs/tiny"
    for seed in (0, 1):
        write_run(runs, "streams", seed)
    out = reported(runs)
    assert list(table(out, "main").index) == ["streams", *UNTRAINED]
    assert "ablation" not in set(tables(out)["table"])
    page = page_of(out)
    assert "no finished run of the ladder is here" in page
    assert "| seed | 0, 1 |" in page


# ---------------------------------------------------------------------------------- what it refuses


def unfinish(runs):
    for path in runs.rglob("results.csv"):
        path.unlink()


def empty_log(runs):
    (runs / "weights/seed1/metrics.csv").write_text("")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (unfinish, r"tiny: holds no finished run \(attitude seed 0: unfin"),
        (empty_log, r"metrics\.csv: not a readable table"),
    ],
)
def test_a_broken_run_or_none_at_all_is_one_line_and_leaves_nothing(runs, damage, said):
    damage(runs)
    with pytest.raises(UserError, match=said):
        reported(runs)
    assert not (runs / "report").exists()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"seeds": [0, "a"]}, r"^task\.seeds: 'a' is no seed"),
        (
            {"rungs": ["basline", "skyocc"]},
            r"^task.rungs: no run and .* called 'basline'; did you mean 'baseline'\?",
        ),
    ],
)
def test_a_seed_or_a_rung_that_there_is_not_is_one_line(ladder, tmp_path, settings, said):
    with pytest.raises(UserError, match=said):
        reported(ladder, out=tmp_path / "out", **settings)
    assert not (tmp_path / "out").exists()


def test_a_place_that_is_no_folder_is_one_line(ladder, tmp_path):
    (tmp_path / "file").write_text("mine")
    for place in ("file", "file/below/it"):
        with pytest.raises(UserError, match=r"^task\.out: .*/file is no folder; choose another"):
            reported(ladder, out=tmp_path / place)
    assert (tmp_path / "file").read_text() == "mine"


def test_a_run_without_a_number_of_epochs_is_reported(runs):
    write_run(runs, "streams", 0, trainer__max_epochs=None)
    (write_run(runs, "streams", 1, trainer__max_epochs=None) / "results.csv").unlink()
    assert "streams seed 1: unfinished, no epoch logged" in page_of(reported(runs))
