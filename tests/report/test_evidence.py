"""Cells of a report: means over seeds, paired differences, and their two-level intervals."""

import dataclasses
import math

import pytest
import torch

from src.metrics.intervals import resamplings, seed_resamplings
from src.metrics.suite import intervals_of
from src.ontology import CLASSES
from src.report.evidence import LONG_TAIL, Evidence
from src.report.report_table import Cell
from tests.report.ladder_runs import CLIPS, SUITE, UNSEEN, predicted, tally

RUNS = {"baseline": {0: 0.3, 1: 0.35, 2: 0.4}, "skyocc": {0: 0.6, 1: 0.5, 2: 0.7}}
SCORES = ("miou", "kar_miou", "iou/car", "ray_iou", "false_free_rate", "long_tail", "gap")


@pytest.fixture(scope="module")
def tallies():
    return {
        name: {
            seed: tally(name, lambda target, n, k=seed, r=right: predicted(target, r, 50 * k + n))
            for seed, right in by_seed.items()
        }
        for name, by_seed in RUNS.items()
    }


@pytest.fixture(scope="module")
def evidence(tallies):
    return Evidence(tallies)


@pytest.fixture(scope="module")
def by_hand(tallies):
    """Scores in percent of clips written out one after the other, a drawn one as often."""
    suite = tallies["skyocc"][0].suite()

    def scores(run, clips):
        found = {}
        for name in ("occupancy", "safety", "rays"):
            tables = {key: table[clips].sum(0) for key, table in run.tables[name].items()}
            found |= {key: float(value) for key, value in suite.metric(name).scores(tables).items()}
        tail = [found[f"iou/{name}"] for name in LONG_TAIL]
        found["long_tail"] = sum(tail) / len(tail)
        found["gap"] = found["miou"] - found["kar_miou"]
        return {name: 100 * value for name, value in found.items()}

    return scores


def draws():
    """The very draws of a report, as lists."""
    clips = resamplings(5, SUITE["resamples"], torch.Generator().manual_seed(0)).long().tolist()
    seeds = seed_resamplings(3, SUITE["resamples"], torch.Generator().manual_seed(1))
    seeds = seeds.long().tolist()
    return [
        [[n for n, times in enumerate(row) for _ in range(times)] for row in both]
        for both in zip(clips, seeds)
    ]


def quantiles(values):
    tails = torch.tensor([0.05, 0.95], dtype=torch.float64)
    return torch.tensor(values, dtype=torch.float64).quantile(tails).tolist()


@pytest.fixture(scope="module")
def looped(tallies, by_hand):
    """Values and bounds of both experiments and of their difference, resample by resample."""
    whole = [[by_hand(run, range(5)) for run in tallies[name].values()] for name in RUNS]
    drawn = [
        [[by_hand(tallies[name][seed], clips) for seed in seeds] for name in RUNS]
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
def test_cells_are_those_of_a_loop_over_resamples_seeds_and_clips(looped, evidence, score):
    cells = [evidence.cell(name, score) for name in RUNS]
    cells.append(evidence.difference("skyocc", "baseline", score))
    for cell, expected in zip(cells, looped(score)):
        assert (cell.value, cell.low, cell.high) == pytest.approx(expected)
        assert cell.low < cell.high


def test_with_one_seed_the_intervals_are_those_of_the_run_itself(tallies):
    run = tallies["skyocc"][1]
    evidence = Evidence({"skyocc": {1: run}})
    alone = intervals_of(run.suite(), run.tables, run.rows(), SUITE["resamples"], 0, 0.9)
    for score in ("miou", "kar_miou", "iou/vru", "ray_iou", "collision_miss_rate"):
        cell = evidence.cell("skyocc", score)
        expected = [100 * number for number in alone[score]]
        assert (cell.value, cell.low, cell.high) == pytest.approx(expected)


def test_the_share_of_resamples_that_miss_a_class_is_counted(tallies):
    run = tallies["skyocc"][0]

    def lost(clips_with_vru):
        count = run.tables["occupancy"]["count"].clone()
        count[clips_with_vru:, CLASSES.index("vru")] = 0
        occupancy = {**run.tables["occupancy"], "count": count}
        tables = {**run.tables, "occupancy": occupancy}
        return Evidence({"skyocc": {0: dataclasses.replace(run, tables=tables)}}).lost

    assert lost(len(CLIPS)) == 0
    assert lost(0) == 0, "of a class that is nowhere nothing is missed"
    drawn = [clips for clips, _ in draws()]
    missed = sum(0 not in clips for clips in drawn) / len(drawn)
    assert 0.1 < missed < 0.6
    assert lost(1) == pytest.approx(missed)


def test_a_part_is_resampled_from_its_own_clips(tallies, by_hand):
    part = Evidence(tallies, lambda clip: clip in UNSEEN)
    assert (part.clips, part.frames) == (1, 3)  # the last clip has no frame
    expected = [by_hand(run, [4])["miou"] for run in tallies["skyocc"].values()]
    cell = part.cell("skyocc", "miou")
    assert cell.value == pytest.approx(sum(expected) / 3)
    # There is one clip, so nothing but the seeds moves the score.
    assert min(expected) <= cell.low < cell.high <= max(expected)


def test_one_clip_and_one_seed_have_no_interval(tallies):
    alone = {name: {0: of_seeds[0]} for name, of_seeds in tallies.items()}
    part = Evidence(alone, lambda clip: clip == CLIPS[0])
    cells = part.cell("skyocc", "miou"), part.difference("skyocc", "baseline", "miou")
    assert not any(math.isnan(cell.value) or cell.has_bounds for cell in cells)


def test_differences_are_over_the_seeds_that_both_have(tallies):
    """Seed 0 of one and all of the other: the change of seed 0, not of the means."""
    uneven = Evidence({"baseline": tallies["baseline"], "skyocc": {0: tallies["skyocc"][0]}})
    found = uneven.difference("skyocc", "baseline", "miou")
    pair = Evidence({name: {0: tallies[name][0]} for name in RUNS})
    assert found == pair.difference("skyocc", "baseline", "miou")
    assert uneven.difference("baseline", "skyocc", "miou").value == pytest.approx(-found.value)
    means = uneven.cell("skyocc", "miou").value - uneven.cell("baseline", "miou").value
    assert abs(found.value - means) > 0.1


def test_paired_draws_make_differences_narrower(evidence, tallies):
    """Of a rung and itself under other seeds' numbers, only the seeds are left to move it."""
    same = Evidence({"baseline": tallies["baseline"], "skyocc": tallies["baseline"]})
    assert same.difference("skyocc", "baseline", "miou") == Cell(0.0, 0.0, 0.0, signed=True)
    cell = evidence.cell("skyocc", "miou")
    change = evidence.difference("skyocc", "baseline", "miou")
    assert change.high - change.low < 2 * (cell.high - cell.low)


def test_there_is_no_difference_without_a_partner(tallies):
    lone = Evidence({"skyocc": {0: tallies["skyocc"][0]}, "weights": {1: tallies["skyocc"][1]}})
    assert lone.difference("skyocc", "baseline", "miou") is None
    assert lone.difference("baseline", "skyocc", "miou") is None
    assert lone.difference("baseline", "baseline", "miou") is None
    assert lone.difference("skyocc", "weights", "miou") is None  # no common seed
    assert lone.cell("baseline", "miou") is None


def test_an_experiment_differs_from_itself_by_nothing_and_without_doubt(evidence):
    cell = evidence.difference("baseline", "baseline", "miou")
    assert cell.value == 0
    assert not cell.has_bounds


def test_a_score_that_a_suite_lacks_is_no_cell(tallies):
    blind = tally("skyocc", lambda target, n: target.clamp(max=8), cameras=False)
    mixed = Evidence({"skyocc": {0: blind}, "baseline": tallies["baseline"]})
    assert mixed.has("ray_iou")
    assert mixed.cell("skyocc", "ray_iou") is None
    assert mixed.difference("skyocc", "baseline", "ray_iou") is None
    assert math.isnan(mixed.value("skyocc", 0, "ray_iou"))
    assert not Evidence({"skyocc": {0: blind}}).has("ray_iou")


def test_clips_with_a_label_of_a_class_are_counted(tallies):
    count = tallies["skyocc"][0].tables["occupancy"]["count"]
    evidence = Evidence(tallies)
    assert evidence.labelled_clips["vru"] == int((count[:5, 6].sum(-1) > 0).sum())
