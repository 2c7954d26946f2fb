"""The paper's tables: their rows, their columns, and what a missing rung leaves of them."""

from itertools import pairwise

import pytest

from src.errors import UserError
from src.metrics.safety import BLOCKED
from src.ontology import CLASSES
from src.report.ladder import PAPER, ladder_named
from src.report.ladder_report import sampling_table
from src.report.paper_tables import CLASS_NAMES, paper_tables
from src.report.run_group import APART, DERIVED, Part
from src.results.render import Cell
from src.results.table import Resamples
from tests.results.scored import RIGHT, counts, counts_by_seed

RUNGS = ["Baseline", "+ Attitude-aware projection", "+ Safety-prior class weights", "SkyOcc"]
MARKS = {name: [name, "✓", "✗"] for name in (*RIGHT, "lss")}


@pytest.fixture(scope="module")
def scored():
    rights = RIGHT | {"lss": 0.2, "bilinear": 0.25}
    of_seeds = {name: dict.fromkeys((0, 1), right) for name, right in rights.items()}
    return counts_by_seed(of_seeds | {"voxel_prior": {0: 0.1}})


def part_of(scored, name="test", ladder=(), without=()):
    scored = {key: runs for key, runs in scored.items() if key not in without}
    return Part(Resamples(scored, name, without=APART, derived=DERIVED), ladder_named(ladder))


def tables_of(part, frames=4):
    """The tables of a part by their keys."""
    return {table.key: table for table in paper_tables(part, MARKS, {frames})}


@pytest.fixture(scope="module")
def part(scored):
    return part_of(scored)


@pytest.fixture(scope="module")
def tables(part):
    return tables_of(part)


def names(table):
    return [name for name, _ in table.rows]


def numbers(table, name):
    return {row: cell.value for row, cell in zip(names(table), table.entries(name))}


def change(part, *key):
    """A change from a reference, in percentage points."""
    return pytest.approx(100 * float(part.resamples.change(*key)[0]))


def test_the_main_table_has_the_ladder_then_the_others_by_name_then_the_anchors(tables, scored):
    table = tables["main"]
    assert names(table) == [*RUNGS, "bilinear", "lss", "Voxel prior"]
    assert table.lines == (4, 6)
    assert table.columns == [*(CLASS_NAMES[name] for name in CLASSES), "mIoU", "KAR-mIoU"]
    assert all(isinstance(cell, Cell) and cell.bounds() for _, row in table.rows for cell in row)
    for name, row in (("baseline", "Baseline"), ("lss", "lss")):
        scores = [float(run.scores("occupancy")["miou"]) for run in scored[name].values()]
        assert numbers(table, "mIoU")[row] == pytest.approx(100 * sum(scores) / 2)


def test_differences_are_those_of_the_scores_beside_them(tables):
    """With the same seeds everywhere every table tells the same story."""
    columns = {"mIoU": "Δ mIoU", "KAR-mIoU": "Δ KAR", "Thin Struct.": "Δ Thin", "VRU": "Δ VRU"}
    for score, delta in columns.items():
        scores = numbers(tables["main"], score)
        for name, change in numbers(tables["ablation"], delta).items():
            assert change == pytest.approx(scores[name] - scores["Baseline"])

    miou = numbers(tables["ablation"], "mIoU")
    steps = numbers(tables["incremental"], "Δ mIoU")
    assert list(steps.values()) == pytest.approx([b - a for a, b in pairwise(miou.values())])


def test_the_ablation_has_the_factors_and_what_they_gain(tables):
    table = tables["ablation"]
    assert names(table) == RUNGS
    assert table.rows[2][1][:3] == MARKS["weights"]
    assert table.columns == [
        *("Att. Proj.", "Class Weight", "Lovász", "mIoU", "KAR-mIoU"),
        *("Δ mIoU", "Δ KAR", "Δ Thin", "Δ VRU"),
    ]
    assert all(cell.value == 0 and not cell.bounds() for cell in table.rows[0][1][5:])


def test_the_long_tail_ends_with_the_gain_of_the_full_model(tables):
    table = tables["long_tail"]
    *rungs, (name, gain) = table.rows
    assert (name, table.lines) == ("Gain of full model", (4,))
    assert [row for row, _ in rungs] == ["Multi-frame baseline", *RUNGS[1:3], "+ Lovász-Softmax"]
    for n, cell in enumerate(gain):
        assert cell.signed
        assert cell.value == pytest.approx(rungs[3][1][n].value - rungs[0][1][n].value)
    means = [sum(cell.value for cell in row[:4]) / 4 for _, row in rungs]
    assert [row[4].value for _, row in rungs] == pytest.approx(means, abs=0.2)
    assert 4 not in table.best_rows("Car")


def test_the_progression_has_the_gap(tables, part):
    table = tables["progression"]
    miou, kar, gap = (numbers(table, name) for name in ("mIoU", "KAR-mIoU", "Gap"))
    assert gap == pytest.approx({name: miou[name] - kar[name] for name in miou})
    assert not table.best_rows("Gap"), "the lowest is that of what finds nothing"
    assert names(tables_of(part, frames=1)["progression"])[0] == "Single-frame baseline"


def test_scores_beyond_the_paper_say_which_end_is_better_and_include_those_of_ones_own(tables):
    assert tables["beyond"].best == {
        **dict.fromkeys(("mIoU occupied", "Geometric IoU", "RayIoU", "Primitive AUC"), "high"),
        **dict.fromkeys(("Primitive miss", "Object miss", "Plan regret"), "low"),
        **dict.fromkeys(("Collision-miss rate", "False-free rate"), "low"),
    }
    blind = counts("skyocc", lambda target, n: target.clamp(max=8), cameras=False)
    mine = part_of({"skyocc": {0: blind}})
    mine.resamples.scores_of["mine"] = ["collision_miss_frames"]
    columns = tables_of(mine)["beyond"].columns
    assert columns[-1] == "collision_miss_frames"
    assert "RayIoU" not in columns, "a score that no run has"


# ----------------------------------------------------------------------------------- an own ladder


def test_an_own_ladder_has_its_own_rungs_and_reference(scored):
    part = part_of(scored, ladder=["weights", "skyocc", "lss"])
    tables = tables_of(part)
    assert names(tables["ablation"]) == ["weights", "SkyOcc", "lss"]
    assert "relative to weights." in tables["ablation"].caption
    changes = numbers(tables["ablation"], "Δ KAR")
    assert changes["lss"] == change(part, "lss", "weights", "kar_miou")
    assert changes["weights"] == 0
    steps = numbers(tables["incremental"], "Δ mIoU")
    assert list(steps) == ["Lovász-Softmax", "lss"]
    assert steps["lss"] == change(part, "lss", "skyocc", "miou")
    assert names(tables["progression"]) == ["weights", "+ Lovász-Softmax", "lss"]
    assert names(tables["long_tail"])[-1] == "Gain of lss"
    assert names(tables["main"])[3:6] == ["attitude", "baseline", "bilinear"]


@pytest.mark.parametrize(("last", "name"), [("skyocc", "SkyOcc"), ("weights", "weights")])
def test_a_step_that_the_paper_does_not_take_has_not_its_name(scored, last, name):
    tables = tables_of(part_of(scored, ladder=["baseline", last]))
    assert names(tables["incremental"]) == [name]
    assert names(tables["progression"]) == ["Multi-frame baseline", name]
    assert names(tables["main"])[1] == name


@pytest.mark.parametrize("experiments", [["skyocc", "skyocc"], ["skyocc", "all_free"]])
def test_a_rung_twice_or_an_anchor_is_refused(experiments):
    with pytest.raises(UserError, match=r"^task\.rungs: "):
        ladder_named(experiments)
    assert ladder_named([]) == PAPER == ladder_named(list(PAPER.names))


# ------------------------------------------------------------------------------- what is missing


def test_a_missing_rung_leaves_its_row_out_and_no_wrong_change_behind(scored):
    tables = tables_of(part_of(scored, without=["attitude"]))
    assert names(tables["ablation"]) == [RUNGS[0], *RUNGS[2:]]
    steps = tables["incremental"]
    assert names(steps) == ["Safety-prior class weights", "Lovász-Softmax"]
    weights, lovasz = (entries for _, entries in steps.rows)
    assert set(weights) == {None}  # not the change from the baseline
    assert None not in lovasz


@pytest.mark.parametrize("missing", ["baseline", "skyocc"])
def test_without_either_end_there_is_no_gain(scored, missing):
    tables = tables_of(part_of(scored, without=[missing]))
    assert names(tables["long_tail"])[-1].startswith("+ ")
    assert tables["long_tail"].lines == ()
    for _, entries in tables["ablation"].rows:
        assert (entries[5:] == [None] * 4) == (missing == "baseline")
        assert entries[3].value > 0


def test_a_single_rung_has_no_step_and_a_part_its_own_name(scored):
    of_test, of_unseen = (
        tables_of(part_of({"baseline": scored["baseline"]}, name))
        for name in ("test", "test_unseen_clips")
    )
    assert list(of_test) == ["main", "ablation", "long_tail", "progression", "beyond"]
    assert list(of_unseen) == [f"{key}_test_unseen_clips" for key in ("main", "ablation", "beyond")]
    title = of_unseen["main_test_unseen_clips"].title
    assert title == "Main results, test_unseen_clips of tiny-0123; recipe unknown"


# ------------------------------------------------------------------------------------- intervals


def sampled(part):
    """The facts of a part's intervals, by their names."""
    table = sampling_table([part.resamples])
    ((name, facts),) = table.rows
    assert name == part.name
    return dict(zip(table.columns, facts))


def test_what_the_intervals_rest_on_is_counted(scored):
    part = part_of(scored)
    frames = scored["skyocc"][0].tables["safety"]["frames"][:, BLOCKED]
    expected = {
        **{"clips": "5", "frames": "7", "resamples": "60", "interval": "90 %", "seeds": "0, 1"},
        **{"lost": "0 %", "blocked": f"{int(frames.sum())} in {int((frames > 0).sum())} clips"},
    }
    assert expected.items() <= sampled(part).items()

    part.resamples.lost = 0.125
    part.resamples.labelled_clips = part.resamples.labelled_clips | {"vru": 0}
    facts = sampled(part)
    assert (facts["lost"], facts["VRU"], facts["ground"]) == ("12 %", "0", "5")


def test_uneven_seeds_are_listed_by_experiment(scored):
    uneven = {name: scored[name] for name in RIGHT} | {"weights": {0: scored["weights"][0]}}
    part = part_of(uneven)
    assert sampled(part)["seeds"] == "0, 1 (baseline, attitude, skyocc); 0 (weights)"
