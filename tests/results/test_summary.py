"""The short table that ends a command, and scores of metrics of one's own in it and in reports."""

import io
from dataclasses import replace

import pytest
import torch
from rich.console import Console

from src.errors import UserError
from src.metrics.count_metric import CountMetric
from src.metrics.protocol import Protocol, require_same_protocol
from src.metrics.suite import require_sound
from src.report.ladder_report import ladder_report
from src.report.run_group import group_of
from src.results.counts import parts_of
from src.results.files import write_scores
from src.results.summary import print_summary, summary_of
from src.run_folder import ANCHORS, NO_RECIPE
from tests.results.scored import (
    GRID,
    UNSEEN,
    counts,
    ladder_of,
    predicted,
    protocol,
    write_run,
)


class Missed(CountMetric):
    """A user's own metric, with a parameter that its protocol names."""

    def __init__(self, grid, below):
        super().__init__({"voxels": (2,)})
        self.below = below

    def frame_counts(self, preds, target):
        low = target < self.below
        return {"voxels": torch.stack([low, low & (preds == 8)], 1).flatten(2).sum(2)}

    def scores(self, counts):
        low, missed = counts["voxels"].double().unbind(-1)
        return {"missed": missed / low}


TARGET = {"_target_": f"{__name__}.Missed", "below": 3}
OTHER = {"_target_": "src.metrics.KARMeanIoU"}


def with_own():
    """The protocol of a suite that has the metric beside all others."""
    suite = protocol().suite
    return replace(protocol(), suite={**suite, "metrics": {**suite["metrics"], "own": TARGET}})


def of_right(name, right, of):
    made = counts(name, lambda target, n: predicted(target, right, n), of=of)
    return replace(made, recipe=NO_RECIPE if name in ANCHORS else "strong")


@pytest.fixture
def folder(tmp_path):
    scored = [of_right(name, 0.3, with_own()) for name in reversed(ANCHORS)]
    scored.insert(0, of_right("skyocc", 0.6, with_own()))
    write_scores(tmp_path, {0: scored}, parts_of(UNSEEN))
    return tmp_path


def test_it_has_the_main_scores_of_the_run_the_anchors_and_the_parts(folder, capsys):
    table = summary_of(folder, "skyocc")
    assert [name for name, _ in table.rows] == [
        *("skyocc", "height_prior", "voxel_prior", "all_free"),
        *("skyocc, unseen clips", "skyocc, seen clips"),
    ]
    assert table.columns[-1] == "missed"
    assert table.title.endswith("; recipe strong")

    console = Console(file=io.StringIO(), width=100)
    print_summary(folder, "skyocc", "python run.py task=report", console)
    text = console.file.getvalue()
    assert len(text.splitlines()) <= 12
    assert "…" not in text
    said = capsys.readouterr().out
    assert "* the best of a column" in said
    assert f"{folder}/scores.csv" in said
    assert said.rstrip().endswith("Next: python run.py task=report")


def test_an_own_metric_changes_no_score_and_splits_no_protocol():
    require_same_protocol({"a": protocol(), "b": with_own(), "c": protocol()})
    assert with_own().digest != protocol().digest, "the file beside the scores names every metric"
    changed = with_own()
    changed.suite["metrics"]["own"] = {**TARGET, "below": 4}
    assert with_own().difference(changed) == ("suite.metrics.own.below", 3, 4)


def test_a_metric_of_this_checkout_needs_no_naming_and_one_elsewhere_does():
    described = Protocol.from_json(with_own().to_json())
    assert counts("skyocc", lambda target, n: target, of=described).own_scores == ["missed"]


def test_runs_with_and_without_an_own_metric_stand_in_one_report(tmp_path):
    """The row was called by the metric's settings, the anchors stood twice, and no table had it."""
    for experiment in ("baseline", "skyocc"):
        write_run(tmp_path, experiment)
    own = write_run(tmp_path, "mine", of=with_own(), suite__metrics__own=TARGET)
    assert own.is_dir()
    group = group_of(ladder_of(tmp_path))
    report = ladder_report(group, [], parts_of, tmp_path / "report")
    beyond = next(table for table in report.tables if table.key == "beyond")
    rows = dict(beyond.rows)
    assert list(rows)[-4:] == ["mine", "All free", "Voxel prior", "Height prior"]
    place = beyond.columns.index("missed")
    assert rows["mine"][place] is not None
    assert rows["SkyOcc"][place] is None
    assert not report.unclean.rows
    (settings,) = [table for table in report.facts if table.key == "settings"]
    assert not [name for name, _ in settings.rows if "suite.metrics" in name]


def test_an_own_metric_that_fails_is_refused_before_the_training():
    """A wrong value of its argument ended a training with a traceback, at its scoring."""
    suite = protocol().suite
    require_sound(GRID, {**suite, "metrics": {**suite["metrics"], "own": TARGET}})
    wrong = {**suite["metrics"], "own": {**TARGET, "below": "quick"}}
    with pytest.raises(UserError, match=r"^suite\.metrics\.own: fails on a frame"):
        require_sound(GRID, {**suite, "metrics": wrong})


class Careless(CountMetric):
    """A metric of a user's own, with a mistake of its kind."""

    def __init__(self, grid, mistake):
        super().__init__({"near": (2,)})
        self.mistake = mistake
        if mistake == "overwritten":
            self.near = torch.ones(grid.shape, dtype=torch.bool)

    def frame_counts(self, preds):
        name = "nearr" if self.mistake == "returned" else "near"
        return {name: torch.ones(len(preds), 2, dtype=torch.int64)}

    def scores(self, counts):
        near = counts["neer" if self.mistake == "asked" else "near"]
        return {"nearness": near[..., 0] / near[..., 1]}


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        ("overwritten", r"self\.near: holds the count of this name"),
        ("returned", "frame_counts: gives 'nearr', and the metric counts near"),
        ("asked", r"fails on a frame \('neer'\)"),
    ],
)
def test_a_mistake_in_an_own_metric_is_told_with_its_name(mistake, told):
    suite = protocol().suite
    own = {"_target_": f"{__name__}.Careless", "mistake": mistake}
    with pytest.raises(UserError, match=rf"^suite\.metrics\.own: {told}"):
        require_sound(GRID, {**suite, "metrics": {**suite["metrics"], "own": own}})
    require_sound(GRID, {**suite, "metrics": {**suite["metrics"], "own": {**own, "mistake": ""}}})
