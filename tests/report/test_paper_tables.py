"""The paper's tables: their rows, their columns, and what a missing rung leaves of them."""

import dataclasses
import math
from itertools import pairwise

import pytest
from src.report.evidence import Evidence
from src.report.report_table import Cell, Column, ReportTable
from src.report.scored_part import ScoredPart

from src.errors import UserError
from src.metrics.safety import BLOCKED
from src.ontology import CLASSES
from src.report.ladder import PAPER, ladder_named
from src.report.paper_tables import (
    ablation_table,
    beyond_table,
    incremental_table,
    long_tail_table,
    main_table,
    progression_table,
)
from tests.results.scored import CLIPS, RIGHT, predicted, tally

MARKS = {
    **{"baseline": ("✗", "✗", "✗"), "attitude": ("✓", "✗", "✗")},
    **{"weights": ("✓", "✓", "✗"), "skyocc": ("✓", "✓", "✓")},
}
SEEDS = (0, 1)


@pytest.fixture(scope="module")
def tallies():
    made = {
        name: {
            seed: tally(name, lambda target, n, k=seed, r=right: predicted(target, r, 50 * k + n))
            for seed in SEEDS
        }
        for name, right in (*RIGHT.items(), ("lss", 0.2), ("bilinear", 0.25))
    }
    return made | {"voxel_prior": {0: tally("voxel_prior", lambda t, n: predicted(t, 0.1, n))}}


def part_of(tallies, *without, name="test", **other_seeds):
    kept = {key: runs for key, runs in tallies.items() if key not in without}
    for key, seeds in other_seeds.items():
        kept[key] = {seed: tallies[key][seed] for seed in seeds}
    return ScoredPart(name, "tiny-0123", Evidence(kept))


@pytest.fixture(scope="module")
def part(tallies):
    return part_of(tallies)


def column(table, key):
    """Entries of a column by the row's name."""
    n = [column.key for column in table.columns].index(key)
    return {name: entries[n] for name, entries in table.rows}


def numbers(table, key):
    return {name: cell.value for name, cell in column(table, key).items()}


def test_the_main_table_has_the_ladder_then_the_others_by_name_then_the_anchors(part):
    table = main_table([part])
    assert [name for name, _ in table.rows] == [
        *("Baseline", "+ Attitude-aware projection", "+ Safety-prior class weights", "SkyOcc"),
        *("bilinear", "lss", "Voxel prior"),
    ]
    assert table.lines == (4, 6)
    assert [each.key for each in table.columns] == [
        *(f"iou/{name}" for name in CLASSES),
        *("miou", "kar_miou"),
    ]
    assert [each.name for each in table.columns[3:5]] == ["Thin Struct.", "Large Veh."]
    assert all(isinstance(cell, Cell) and cell.has_bounds for _, row in table.rows for cell in row)


def test_a_score_is_the_mean_of_the_seeds_in_percent(part, tallies):
    found = numbers(main_table([part]), "miou")
    for name, row in (("baseline", "Baseline"), ("skyocc", "SkyOcc"), ("lss", "lss")):
        scores = [
            part.evidence.suite.metric("occupancy").scores(
                {key: table.sum(0) for key, table in run.tables["occupancy"].items()}
            )["miou"]
            for run in tallies[name].values()
        ]
        assert found[row] == pytest.approx(100 * float(sum(scores)) / 2)


def test_differences_are_those_of_the_scores_beside_them(part):
    """With the same seeds everywhere every table tells the same story."""
    ablation = ablation_table(part, MARKS)
    for score in ("miou", "kar_miou"):
        scores, changes = numbers(ablation, score), numbers(ablation, f"delta_{score}")
        for name, score_there in scores.items():
            assert changes[name] == pytest.approx(score_there - scores["Baseline"])
    thin = numbers(main_table([part]), "iou/thin_structure")
    changes = numbers(ablation, "delta_iou/thin_structure")
    assert changes["SkyOcc"] == pytest.approx(thin["SkyOcc"] - thin["Baseline"])
    steps, miou = numbers(incremental_table(part), "delta_miou"), numbers(ablation, "miou")
    expected = [above - below for below, above in pairwise(miou.values())]
    assert list(steps.values()) == pytest.approx(expected)
    assert sum(steps.values()) == pytest.approx(numbers(ablation, "delta_miou")["SkyOcc"])


def test_the_ablation_has_the_factors_and_what_they_gain(part):
    table = ablation_table(part, MARKS)
    assert table.rows[2][1][:3] == ("✓", "✓", "✗")
    assert [each.name for each in table.columns] == [
        *("Att. Proj.", "Class Weight", "Lovász", "mIoU", "KAR-mIoU"),
        *("Δ mIoU", "Δ KAR", "Δ Thin", "Δ VRU"),
    ]
    first = table.rows[0][1][5:]
    assert all(cell.value == 0 and not cell.has_bounds for cell in first)
    assert not {"lss", "Voxel prior"} & {name for name, _ in table.rows}


def test_the_long_tail_ends_with_the_gain_of_the_full_model(part):
    table = long_tail_table(part, frames={4})
    *rungs, (name, gain) = table.rows
    assert name == "Gain of full model"
    assert [row for row, _ in rungs] == [
        *("Multi-frame baseline", "+ Attitude-aware projection"),
        *("+ Safety-prior class weights", "+ Lovász-Softmax"),
    ]
    for n, cell in enumerate(gain):
        assert cell.signed
        assert cell.value == pytest.approx(rungs[3][1][n].value - rungs[0][1][n].value)
    means = [sum(cell.value for cell in row[:4]) / 4 for _, row in rungs]
    assert [row[4].value for _, row in rungs] == pytest.approx(means, abs=0.2)
    assert table.lines == (4,)
    assert 4 not in table.best_rows(0)


def test_the_progression_has_the_gap(part):
    table = progression_table(part, frames={4})
    miou, kar, gap = (numbers(table, key) for key in ("miou", "kar_miou", "gap"))
    assert gap == pytest.approx({name: miou[name] - kar[name] for name in miou})
    assert not table.best_rows(4), "the lowest is that of what finds nothing"
    alone = progression_table(part, frames={1})
    assert alone.rows[0][0] == "Single-frame baseline"
    assert "sees 1 frame." in alone.caption


def test_scores_beyond_the_paper_say_which_end_is_better(part):
    table = beyond_table([part])
    best = {column.key: column.best for column in table.columns}
    assert best == {
        **dict.fromkeys(("miou_occupied", "geometric_iou", "ray_iou"), "high"),
        **dict.fromkeys(("collision_miss_rate", "false_free_rate"), "low"),
    }
    assert table.rows[-1][0] == "Voxel prior"
    rates = numbers(table, "false_free_rate")
    (marked,) = table.best_rows(4)
    assert rates[table.rows[marked][0]] == min(rates.values())


def test_the_caption_says_how_many_frames_have_something_in_the_way(part, tallies):
    frames = tallies["skyocc"][0].tables["safety"]["frames"][:, BLOCKED]
    of_clips = int((frames > 0).sum())
    words = f"rests on the {int(frames.sum())} frames, of {of_clips} clips, with something in the"
    assert words in beyond_table([part]).caption
    assert of_clips
    other = part_of(tallies)
    other.evidence.blocked = (1, 1)
    assert "rests on the 1 frame, of 1 clip, with something" in beyond_table([other]).caption


def test_the_best_row_is_one_of_those_that_were_scored_alike():
    cells = [("a", (Cell(1.0),)), ("b", (Cell(2.0),)), ("elsewhere", (Cell(3.0),))]
    column = Column("score", "Score", best="high")
    assert ReportTable("k", "t", "c", (column,), tuple(cells), ranked=2).best_rows(0) == {1}


# ----------------------------------------------------------------------------------- an own ladder


def test_an_own_ladder_has_its_own_rungs_and_reference(tallies):
    ladder = ladder_named(["weights", "skyocc", "lss"])
    part = dataclasses.replace(part_of(tallies), ladder=ladder)
    marks = MARKS | {"lss": ("✓", "✓", "✓")}
    table = ablation_table(part, marks)
    rows = [name for name, _ in table.rows]
    assert rows == ["weights", "SkyOcc", "lss"]
    assert "relative to weights." in table.caption
    changes = column(table, "delta_kar_miou")
    expected = part.evidence.difference("lss", "weights", "kar_miou")
    assert changes["lss"] == expected
    assert changes["weights"].value == 0
    steps = incremental_table(part)
    assert [name for name, _ in steps.rows] == ["Lovász-Softmax", "lss"]
    assert column(steps, "delta_miou")["lss"] == part.evidence.difference("lss", "skyocc", "miou")
    names = [name for name, _ in progression_table(part, {4}).rows]
    assert names == ["weights", "+ Lovász-Softmax", "lss"]
    assert long_tail_table(part, {4}).rows[-1][0] == "Gain of lss"
    assert "lss" in {name for name, _ in main_table([part]).rows}
    assert part.others == ["attitude", "baseline", "bilinear"]


def test_a_step_that_the_paper_does_not_take_has_not_its_name(tallies):
    part = dataclasses.replace(part_of(tallies), ladder=ladder_named(["baseline", "skyocc"]))
    assert [name for name, _ in incremental_table(part).rows] == ["SkyOcc"]
    assert next(name for name, _ in progression_table(part, {4}).rows) == "Multi-frame baseline"
    part = dataclasses.replace(part, ladder=ladder_named(["baseline", "weights"]))
    for table in (incremental_table(part), main_table([part]), progression_table(part, {4})):
        assert "weights" in {name for name, _ in table.rows}
        assert not any("Safety-prior" in name for name, _ in table.rows)


@pytest.mark.parametrize("names", [["skyocc", "skyocc"], ["skyocc", "all_free"]])
def test_a_rung_twice_or_an_anchor_is_refused(names):
    with pytest.raises(UserError, match=r"^task\.rungs: "):
        ladder_named(names)


def test_without_names_it_is_the_papers():
    assert ladder_named([]) == PAPER == ladder_named(list(PAPER.names))


def test_scores_that_no_run_has_are_no_columns():
    blind = tally("skyocc", lambda target, n: target.clamp(max=8), cameras=False)
    table = beyond_table([part_of({"skyocc": {0: blind}})])
    assert "ray_iou" not in {column.key for column in table.columns}


# ------------------------------------------------------------------------------- what is missing


def test_a_missing_rung_leaves_its_row_out_and_no_wrong_change_behind(tallies):
    part = part_of(tallies, "attitude")
    rows = [name for name, _ in ablation_table(part, MARKS).rows]
    assert rows == ["Baseline", "+ Safety-prior class weights", "SkyOcc"]
    steps = incremental_table(part)
    assert [name for name, _ in steps.rows] == ["Safety-prior class weights", "Lovász-Softmax"]
    weights, lovasz = (entries for _, entries in steps.rows)
    assert set(weights) == {None}  # not the change from the baseline
    assert None not in lovasz


def test_without_a_baseline_there_is_no_gain(tallies):
    part = part_of(tallies, "baseline")
    table = ablation_table(part, MARKS)
    assert all(entries[5:] == (None,) * 4 for _, entries in table.rows)
    assert all(not math.isnan(entries[3].value) for _, entries in table.rows)
    assert long_tail_table(part, {4}).rows[-1][0] == "+ Lovász-Softmax", "nor a row for it"


def test_without_the_full_model_its_gain_is_no_row(tallies):
    table = long_tail_table(part_of(tallies, "skyocc"), {4})
    assert [name for name, _ in table.rows][-1] == "+ Safety-prior class weights"
    assert table.lines == ()


def test_a_single_rung_has_no_step(tallies):
    only = part_of({"baseline": tallies["baseline"]})
    assert incremental_table(only).rows == ()
    assert len(main_table([only]).rows) == 1


def test_a_part_has_tables_of_its_own_name(tallies):
    table = main_table([part_of(tallies, name="test_unseen_clips")])
    assert table.key == "main_test_unseen_clips"
    assert table.title == "Main results, test_unseen_clips of tiny-0123"


# ------------------------------------------------------------------------------------- captions


def test_a_caption_counts_seeds_and_clips(part):
    caption = ablation_table(part, MARKS).caption
    assert "90 % percentile intervals over 60 resamples of 2 seeds and, independently, " in caption
    assert "5 clips (7 frames), the same for every row; from so few they are coarse" in caption
    assert caption.endswith("Seeds: 0, 1.")


def test_one_seed_says_that_only_clips_are_drawn(tallies):
    one = {name: {0: runs[0]} for name, runs in tallies.items()}
    caption = main_table([part_of(one)]).caption
    assert "resamples of 5 clips (7 frames)" in caption
    assert "With one seed only clips are drawn" in caption
    assert caption.endswith("Seed: 0.")


def test_one_clip_says_that_only_seeds_are_drawn(tallies):
    alone = ScoredPart("test", "d", Evidence(tallies, lambda clip: clip == CLIPS[0]))
    assert "There is one clip, so only seeds are drawn." in main_table([alone]).caption
    single = Evidence({"skyocc": {0: tallies["skyocc"][0]}}, lambda clip: clip == CLIPS[0])
    caption = main_table([ScoredPart("test", "d", single)]).caption
    assert "No intervals: there is one seed and one clip" in caption


def test_uneven_seeds_are_listed_and_explained_where_there_are_differences(tallies):
    part = part_of(tallies, "lss", "bilinear", weights=[0])
    caption = ablation_table(part, MARKS).caption
    assert "Seeds: baseline 0, 1; attitude 0, 1; weights 0; skyocc 0, 1." in caption
    assert caption.endswith("Differences are over the seeds that both rungs have.")
    assert "Differences" not in main_table([part]).caption


def test_a_class_that_some_resamples_miss_is_told(tallies):
    part = part_of(tallies)
    assert part.evidence.lost == 0
    assert "no voxel of some class" not in main_table([part]).caption
    part.evidence.lost = 0.125
    assert "In 12 % of the resamples no voxel of some class is drawn" in main_table([part]).caption


def test_a_class_that_no_voxel_has_is_told(tallies):
    part = part_of(tallies)
    part.evidence.labelled_clips["vru"] = 0
    tables = (main_table([part]), beyond_table([part]), ablation_table(part, MARKS))
    assert all("Not one voxel is labelled VRU:" in table.caption for table in tables)
    assert "Not one voxel" not in main_table([part_of(tallies)]).caption
