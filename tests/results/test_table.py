"""The long table: means over seeds, paired differences, and their two-level intervals."""

import dataclasses
import math

import pytest
import torch

from src.ontology import CLASSES
from src.results.bootstrap import interval_of, resamplings, seed_resamplings
from src.results.counts import parts_of
from src.results.files import run_table
from src.results.render import Cell
from src.results.table import AS_RECORDED, MEAN, Resamples, pivoted
from tests.results.scored import CLIPS, SUITE, UNSEEN, counts, counts_by_seed

RUNS = {"baseline": {0: 0.3, 1: 0.35, 2: 0.4}, "skyocc": {0: 0.6, 1: 0.5, 2: 0.7}}
SCORES = ("miou", "kar_miou", "iou/car", "ray_iou", "false_free_rate", "gap")
DERIVED = {"gap": lambda scores: scores["miou"] - scores["kar_miou"]}


@pytest.fixture(scope="module")
def scored():
    return counts_by_seed(RUNS)


@pytest.fixture(scope="module")
def resamples(scored):
    return Resamples(scored, derived=DERIVED)


def one_clip(scored):
    return Resamples(scored, "one", chosen=lambda clip: clip == CLIPS[0])


def value(resamples, *key):
    return float(resamples.mean(*key)[0]) if len(key) == 2 else float(resamples.change(*key)[0])


@pytest.fixture(scope="module")
def by_hand(scored):
    """Scores of clips written out one after the other, a drawn one as often."""
    suite = scored["skyocc"][0].suite()

    def scores(run, clips):
        found = {}
        for name in ("occupancy", "safety", "rays"):
            tables = {key: table[clips].sum(0) for key, table in run.tables[name].items()}
            found |= {key: float(value) for key, value in suite.metric(name).scores(tables).items()}
        return found | {"gap": found["miou"] - found["kar_miou"]}

    return scores


def draws():
    """The very draws of a report, as lists."""
    clips = resamplings(5, SUITE["resamples"], torch.Generator().manual_seed(0)).long().tolist()
    seeds = seed_resamplings(3, SUITE["resamples"], torch.Generator().manual_seed(1))
    return [
        [[n for n, times in enumerate(row) for _ in range(times)] for row in both]
        for both in zip(clips, seeds.long().tolist())
    ]


def quantiles(values):
    tails = torch.tensor([0.05, 0.95], dtype=torch.float64)
    return torch.tensor(values, dtype=torch.float64).quantile(tails).tolist()


@pytest.fixture(scope="module")
def looped(scored, by_hand):
    """Values and bounds of both experiments and of their difference, resample by resample."""
    whole = [[by_hand(run, range(5)) for run in scored[name].values()] for name in RUNS]
    drawn = [
        [[by_hand(scored[name][seed], clips) for seed in seeds] for name in RUNS]
        for clips, seeds in draws()
    ]

    def found(score):
        values, *resampled = (
            [sum(run[score] for run in runs) / 3 for runs in both] for both in (whole, *drawn)
        )
        rows = [(*both, both[1] - both[0]) for both in (values, *resampled)]
        return [(column[0], *quantiles(column[1:])) for column in zip(*rows)]

    return found


@pytest.mark.parametrize("score", SCORES)
def test_rows_are_those_of_a_loop_over_resamples_seeds_and_clips(looped, resamples, score):
    table = resamples.table({"skyocc": ["baseline"]})
    rows = table[(table["seed"] == MEAN) & (table["score"] == score)]
    assert rows[["experiment", "reference"]].to_numpy().tolist() == [
        *(["baseline", ""], ["skyocc", ""], ["skyocc", "baseline"]),
    ]
    for row, expected in zip(rows[["value", "low", "high"]].to_numpy().tolist(), looped(score)):
        assert row == pytest.approx(expected)
        assert row[1] < row[2]
    assert set(rows["clips"]) == {5}
    assert set(rows["frames"]) == {7}
    assert set(rows["condition"]) == {AS_RECORDED}
    assert rows["protocol"].nunique() == 1


def test_a_seed_has_rows_of_its_own_as_in_the_runs_own_table(scored, resamples):
    of_run = run_table({1: [scored["skyocc"][1]]}, parts_of(UNSEEN))
    assert list(of_run["part"].unique()) == ["test", "test_unseen_clips", "test_seen_clips"]
    own = of_run[of_run["part"] == "test"].set_index("score")
    table = resamples.table()
    rows = table[(table["experiment"] == "skyocc") & (table["seed"] == "1")].set_index("score")
    both = rows.index.intersection(own.index)
    assert {"miou", "ece", "all/kar_miou"} & set(both) == {"miou", "all/kar_miou"}
    columns = ["seed", "value", "low", "high", "clips", "frames", "protocol"]
    assert rows.loc[both, columns].equals(own.loc[both, columns])
    assert not set(own.columns) & {"reference", "reference_condition"}


def test_cells_of_a_small_table_are_percentages_and_changes_are_signed(resamples):
    rows = [(f"row of {name}", {"experiment": name}) for name in ("skyocc", "nobody")]
    columns = [{"score": "miou"}, {"score": "miou", "reference": "baseline"}]
    table = resamples.table({"skyocc": ["baseline"]})
    (name, (score, change)), nothing = pivoted(table, rows, columns)
    assert name == "row of skyocc"
    assert nothing == ("row of nobody", [None, None])
    interval = interval_of(resamples.mean("skyocc", "miou"), 0.9)
    assert score == Cell(*(100 * number for number in interval))
    assert change.signed
    assert change.value == pytest.approx(100 * value(resamples, "skyocc", "baseline", "miou"))
    elsewhere = {"experiment": "skyocc", "part": "elsewhere"}
    assert pivoted(table, [("x", elsewhere)], columns) == [("x", [None, None])]


def test_the_share_of_resamples_that_miss_a_class_is_counted(scored):
    run = scored["skyocc"][0]

    def lost(clips_with_vru):
        count = run.tables["occupancy"]["count"].clone()
        count[clips_with_vru:, CLASSES.index("vru")] = 0
        occupancy = {**run.tables["occupancy"], "count": count}
        tables = {**run.tables, "occupancy": occupancy}
        return Resamples({"skyocc": {0: dataclasses.replace(run, tables=tables)}}).lost

    assert lost(len(CLIPS)) == 0
    assert lost(0) == 0, "of a class that is nowhere nothing is missed"
    drawn = [clips for clips, _ in draws()]
    missed = sum(0 not in clips for clips in drawn) / len(drawn)
    assert 0.1 < missed < 0.6
    assert lost(1) == pytest.approx(missed)


def test_a_part_is_resampled_from_its_own_clips(scored, by_hand):
    part = Resamples(scored, "unseen", chosen=lambda clip: clip in UNSEEN)
    assert (part.clips, part.frames) == (1, 3)  # the last clip has no frame
    expected = [by_hand(run, [4])["miou"] for run in scored["skyocc"].values()]
    mean = interval_of(part.mean("skyocc", "miou"), 0.9)
    assert mean.value == pytest.approx(sum(expected) / 3)
    # There is one clip, so nothing but the seeds moves the score.
    assert min(expected) <= mean.low < mean.high <= max(expected)
    assert set(part.table()["part"]) == {"unseen"}


def test_one_clip_and_one_seed_have_no_interval(scored):
    alone = {name: {0: of_seeds[0]} for name, of_seeds in scored.items()}
    table = one_clip(alone).table({"skyocc": ["baseline"]})
    rows = table[table["score"] == "miou"]
    assert rows["value"].notna().all()
    assert rows[["low", "high"]].isna().all(axis=None)


def test_differences_are_over_the_seeds_that_both_have(scored):
    """Seed 0 of one and all of the other: the change of seed 0, not of the means."""
    uneven = Resamples({"baseline": scored["baseline"], "skyocc": {0: scored["skyocc"][0]}})
    pair = Resamples({name: {0: scored[name][0]} for name in RUNS})
    change = uneven.change("skyocc", "baseline", "miou")
    assert torch.equal(change, pair.change("skyocc", "baseline", "miou"))
    assert value(uneven, "baseline", "skyocc", "miou") == pytest.approx(-float(change[0]))
    means = value(uneven, "skyocc", "miou") - value(uneven, "baseline", "miou")
    assert abs(float(change[0]) - means) > 0.001


def test_there_is_no_difference_without_a_partner(scored):
    lone = Resamples({"skyocc": {0: scored["skyocc"][0]}, "weights": {1: scored["skyocc"][1]}})
    assert lone.change("skyocc", "baseline", "miou") is None
    assert lone.change("baseline", "skyocc", "miou") is None
    assert lone.change("baseline", "baseline", "miou") is None
    assert lone.change("skyocc", "weights", "miou") is None  # no common seed
    assert lone.mean("baseline", "miou") is None
    assert (lone.table({"skyocc": ["baseline", "weights"]})["reference"] == "").all()


def test_an_experiment_differs_from_itself_by_nothing_and_without_doubt(resamples):
    assert resamples.change("baseline", "baseline", "miou").tolist() == [0.0]
    table = resamples.table({"baseline": ["baseline"]})
    rows = table[table["reference"] == "baseline"]
    assert (rows["value"] == 0).all()
    assert rows["low"].isna().all()


def test_differences_from_another_condition_are_of_the_same_clips(scored):
    worse = {"skyocc": scored["baseline"]}
    level = Resamples(worse, condition="level")
    true = Resamples(scored, condition="true")
    (row,) = (
        true.table_of_changes({"skyocc": ["skyocc"]}, level)
        .query("score == 'miou'")
        .to_dict("records")
    )
    assert (row["experiment"], row["reference"]) == ("skyocc", "skyocc")
    assert (row["condition"], row["reference_condition"]) == ("true", "level")
    assert row["value"] == pytest.approx(value(true, "skyocc", "baseline", "miou"))
    with pytest.raises(ValueError, match="cannot be paired"):
        true.table_of_changes({"skyocc": ["skyocc"]}, one_clip(worse))


def test_a_score_that_a_suite_lacks_is_no_row(scored):
    blind = counts("skyocc", lambda target, n: target.clamp(max=8), cameras=False)
    mixed = Resamples({"skyocc": {0: blind}, "baseline": scored["baseline"]})
    assert mixed.mean("skyocc", "ray_iou") is None
    assert mixed.change("skyocc", "baseline", "ray_iou") is None
    scores = mixed.table().groupby("experiment")["score"].agg(set)
    assert "ray_iou" in scores["baseline"] - scores["skyocc"]


def test_metrics_may_be_left_out_and_their_scores_are_named(scored):
    drawn = Resamples({"skyocc": scored["skyocc"]}, without=("breakdown", "safety"))
    assert "breakdown" not in drawn.scores_of
    assert "false_free_rate" not in set(drawn.table()["score"])
    assert "ray_iou" in drawn.scores_of["rays"]


def test_clips_with_a_label_of_a_class_are_counted(scored, resamples):
    count = scored["skyocc"][0].tables["occupancy"]["count"]
    assert resamples.labelled_clips["vru"] == int((count[:5, 6].sum(-1) > 0).sum())


def test_without_a_value_there_is_none(scored):
    run = scored["skyocc"][0]
    tables = {m: {k: t * 0 for k, t in of.items()} for m, of in run.tables.items()}
    table = Resamples({"x": {0: dataclasses.replace(run, tables=tables)}}).table()
    assert math.isnan(table.set_index(["seed", "score"]).loc[("0", "kar_miou"), "value"])
