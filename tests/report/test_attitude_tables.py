"""Scores by tilt and under a wrong attitude, of several runs together."""

import dataclasses

import pandas as pd
import pytest
import torch
from src.report.attitude_evidence import AttitudeEvidence

from src.errors import UserError
from src.report.attitude_tables import attitude_tables
from src.results.counts import Counts
from src.results.runs import read_run
from tests.results.presented import write_attitude
from tests.results.scored import CLIPS, FRAMES, protocol, tally, write_run

SEEDS = (0, 1)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    found = {}
    for name, gain in {"baseline": 0.0, "attitude": 0.4, "weights": None}.items():
        for seed in SEEDS:
            found[name, seed] = write_run(runs, name, seed)
            if gain is not None:
                write_attitude(found[name, seed], gain, seed)
    return found


@pytest.fixture(scope="module")
def evidence(folders):
    return AttitudeEvidence([read_run(path) for path in folders.values()])


def score(folders, name, condition):
    """KAR-mIoU in percent, a seed at a time."""
    tallies = [Counts.read(folders[name, s] / f"attitude/tallies/{condition}.npz") for s in SEEDS]
    tables = [{k: v.sum(0) for k, v in t.tables["occupancy"].items()} for t in tallies]
    metric = tallies[0].suite().metric("occupancy")
    return [100 * float(metric.scores(table)["kar_miou"]) for table in tables]


def test_conditions_stand_in_their_order_with_the_true_attitude_first(evidence):
    assert evidence.names("tilt") == ["tilt_0_5deg", "tilt_5_infdeg"]
    assert evidence.names("noise_deg") == ["true", "noise_3deg"]
    assert evidence.names("delay_s") == ["true", "delay_0.2s"]
    assert evidence.names("level") == ["level", "level_tilt_0_5deg", "level_tilt_5_infdeg"]
    assert evidence.experiments == ["baseline", "attitude"]


def test_a_gain_is_the_mean_of_the_differences_of_each_seed(evidence, folders):
    for condition in ("tilt_0_5deg", "tilt_5_infdeg"):
        mine, theirs = (score(folders, name, condition) for name in ("attitude", "baseline"))
        expected = sum(a - b for a, b in zip(mine, theirs)) / len(SEEDS)
        gain = evidence.gain(condition, "attitude", "baseline", "kar_miou")
        assert gain.value == pytest.approx(expected, abs=1e-4)
    assert gain.low > 0
    level = evidence.gain("tilt_0_5deg", "attitude", "baseline", "kar_miou")
    assert (level.low, level.value, level.high) == (0, 0, 0), "the same predictions"


def test_what_the_attitude_is_worth_is_of_the_same_frames_and_seeds(evidence, folders):
    for name in ("baseline", "attitude"):
        for true in ("true", "tilt_0_5deg", "tilt_5_infdeg"):
            told = "level" if true == "true" else f"level_{true}"
            mine, theirs = (score(folders, name, condition) for condition in (true, told))
            expected = sum(a - b for a, b in zip(mine, theirs)) / len(SEEDS)
            worth = evidence.worth(told, name, "kar_miou")
            assert worth.value == pytest.approx(expected, abs=1e-4)
    nothing = evidence.worth("level_tilt_0_5deg", "attitude", "kar_miou")
    assert (nothing.low, nothing.value, nothing.high) == (0, 0, 0), "the same predictions"
    rows = evidence.worths("kar_miou", "attitude").set_index("condition")
    assert list(rows.index) == evidence.names("level")
    assert rows.loc["level_tilt_5_infdeg", "value"] == pytest.approx(worth.value / 100)
    assert not rows["level"].any()


def test_runs_that_were_not_told_a_level_attitude_have_no_such_table(tmp_path):
    runs = pair(tmp_path)
    for run in runs:
        rewrite(run, not_told_level)
        evidence = AttitudeEvidence([read_run(run) for run in runs])
        keys = [table.key for table in attitude_tables(evidence)]
        told = ["attitude_level"] * (run == runs[0])
        assert keys == ["attitude_tilt", *told, "attitude_faults"], "the other one still has it"
    assert len(evidence.worths("kar_miou", "attitude")) == 0


def test_tables_have_scores_and_below_them_the_gains(evidence):
    tilt, level, faults = attitude_tables(evidence)
    assert [column.name for column in level.columns] == [
        "all (7 frames)", "0–5° (2 frames)", "from 5° (5 frames)"
    ]  # fmt: skip
    assert [name for name, _ in level.rows] == [
        *("Baseline", "+ Attitude-aware projection"),
        "Baseline, over told level",
        "+ Attitude-aware projection, over told level",
    ]
    assert level.rows[3][1][2].value > 5
    assert level.lines == (2,)
    assert [column.name for column in tilt.columns] == ["0–5° (2 frames)", "from 5° (5 frames)"]
    assert [column.name for column in faults.columns] == ["true", "3° noise", "0.2 s late"]
    above = "+ Attitude-aware projection"
    names = ["Baseline", above, f"{above}, over the baseline"]
    for table in (tilt, faults):
        assert [name for name, _ in table.rows] == names
        assert table.lines == (2,)
    assert [cell.signed for cell in tilt.rows[2][1]] == [True, True]
    assert "resamples of 2 seeds and, independently, of the clips" in tilt.caption
    assert "Seeds: 0, 1." in tilt.caption


def test_with_one_seed_it_is_not_said_that_seeds_were_drawn(folders):
    tilt, *_ = attitude_tables(AttitudeEvidence([read_run(folders["baseline", 0])]))
    assert "resamples of the clips" in tilt.caption
    assert "With one seed only clips are drawn" in tilt.caption


def test_the_table_of_a_figure_is_in_shares_as_in_the_file(evidence):
    rows = evidence.table("kar_miou", "attitude").set_index("condition")
    cell = evidence.cell("noise_3deg", "attitude", "kar_miou")
    assert rows.loc["noise_3deg", "value"] == pytest.approx(cell.value / 100)
    assert rows.loc["noise_3deg", "noise_deg"] == 3


def test_runs_without_such_scores_have_no_table(folders):
    found = AttitudeEvidence([read_run(folders["weights", 0])])
    assert found.experiments == []
    assert attitude_tables(found) == []


def pair(tmp_path):
    """A baseline and an attitude run, each with scores by attitude."""
    runs = [write_run(tmp_path, name) for name in ("baseline", "attitude")]
    for run in runs:
        write_attitude(run)
    return runs


def rewrite(run, change):
    """Puts ``change(table)`` in the place of a run's ``attitude.csv``."""
    path = run / "attitude/attitude.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)


def not_told_level(table):
    return table[~table["level"]]


def without(condition):
    return lambda table: table[table["condition"] != condition]


def test_scores_under_other_conditions_are_not_put_beside_each_other(tmp_path):
    runs = pair(tmp_path)
    rewrite(runs[1], lambda table: table.assign(noise_seed=1))
    with pytest.raises(
        UserError, match=r"attitude\.csv: .* has noise_seed=1, and elsewhere 0; sco"
    ):
        AttitudeEvidence([read_run(run) for run in runs])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"protocol": protocol("tiny-4567")},
            r"noise_3deg\.npz: was scored with dataset=tiny-4567",
        ),
        (
            {"clips": [f"x/{n}" for n in range(len(CLIPS))]},
            r"was scored on other clips or frames than ",
        ),
        ({"frames": FRAMES[::-1]}, r"was scored on other clips or frames than "),
        (
            {"tables": tally("other", lambda target, n: target, labels=1).tables},
            r"other labels than ",
        ),
    ],
)
def test_scores_of_other_frames_are_not_put_beside_each_other(tmp_path, change, message):
    runs = pair(tmp_path)
    path = runs[1] / "attitude/tallies/noise_3deg.npz"
    dataclasses.replace(Counts.read(path), **change).write(path)
    with pytest.raises(UserError, match=message):
        AttitudeEvidence([read_run(run) for run in runs])


def test_scores_of_another_seed_are_refused(tmp_path):
    run, other = (write_run(tmp_path, "skyocc", seed) for seed in SEEDS)
    write_attitude(run)
    theirs = Counts.read(other / "tallies/skyocc.npz")
    theirs.write(run / "attitude/tallies/true.npz")
    with pytest.raises(UserError, match=r"true\.npz: counts .* % of the voxels .* best checkpoint"):
        AttitudeEvidence([read_run(run)])


def test_scores_of_another_protocol_than_the_runs_are_refused(tmp_path):
    run = write_run(tmp_path, "skyocc")
    write_attitude(run)
    path = run / "attitude/tallies/true.npz"
    true = Counts.read(path)
    metric = true.protocol.metric | {"horizon_s": 4.0}
    dataclasses.replace(true, protocol=dataclasses.replace(true.protocol, metric=metric)).write(
        path
    )
    with pytest.raises(UserError, match=r"scored with metric\.horizon_s=.*score both alike"):
        AttitudeEvidence([read_run(run)])


@pytest.mark.parametrize(("voxels", "accepted"), [(100_000, True), (1_000, False)])
def test_another_machine_may_tip_one_voxel_of_many(tmp_path, voxels, accepted):
    folder = write_run(tmp_path, "skyocc")
    write_attitude(folder)
    run, path = read_run(folder), folder / "attitude/tallies/true.npz"
    tipped = Counts.read(path)
    for each in (run.tally, tipped):
        each.tables["occupancy"]["count"][0, 0, 0] = voxels
    tipped.tables["occupancy"]["count"][0, 0] += torch.tensor([-1, 1, *[0] * 7])
    tipped.write(path)
    if accepted:
        AttitudeEvidence([run])
    else:
        with pytest.raises(UserError, match="of the voxels otherwise than the run"):
            AttitudeEvidence([run])


def test_seeds_of_one_experiment_have_the_same_conditions(tmp_path):
    runs = [write_run(tmp_path, "skyocc", seed) for seed in SEEDS]
    for run in runs:
        write_attitude(run)
    rewrite(runs[1], without("noise_3deg"))
    with pytest.raises(
        UserError, match=r"seed1.*: has other conditions than .*seed0.* \(noise_3deg\); score both"
    ):
        AttitudeEvidence([read_run(run) for run in runs])


def test_an_experiment_that_was_not_told_a_level_attitude_has_no_row_there(tmp_path):
    runs = pair(tmp_path)
    rewrite(runs[1], not_told_level)
    for told in (runs[1] / "attitude/tallies").glob("level*.npz"):
        told.unlink()
    _, level, _ = attitude_tables(AttitudeEvidence([read_run(run) for run in runs]))
    assert [name for name, _ in level.rows] == ["Baseline", "Baseline, over told level"]


def test_frames_of_another_tilt_are_not_paired(evidence):
    true, told = (evidence.evidence[name] for name in ("tilt_0_5deg", "level_tilt_5_infdeg"))
    with pytest.raises(ValueError, match="cannot be paired"):
        true.difference("baseline", "baseline", "kar_miou", told)


def test_other_bins_of_tilt_are_refused(tmp_path):
    runs = pair(tmp_path)
    rewrite(runs[1], without("tilt_0_5deg"))
    with pytest.raises(UserError, match=r"attitude\.csv: has other bins of tilt than "):
        AttitudeEvidence([read_run(run) for run in runs])


@pytest.mark.parametrize("alone", [True, False])
def test_a_condition_without_its_counts_is_one_line(tmp_path, alone):
    runs = pair(tmp_path)
    (runs[1] / "attitude/tallies/delay_0.2s.npz").unlink()
    with pytest.raises(UserError, match=r"delay_0\.2s\.npz: is not there; run task=attitude again"):
        AttitudeEvidence([read_run(run) for run in runs[alone:]])


def test_the_true_attitude_may_be_the_only_condition(tmp_path):
    # "true" in every row of a column is no truth value.
    run = write_attitude(write_run(tmp_path, "skyocc")).parent
    rewrite(run, lambda table: table[table["condition"] == "true"])
    assert AttitudeEvidence([read_run(run)]).names("noise_deg") == ["true"]


def test_what_cannot_be_read_is_one_line(tmp_path):
    run = write_run(tmp_path, "baseline", 0)
    folder = write_attitude(run)
    (folder / "attitude.csv").write_text("nothing\n")
    with pytest.raises(UserError, match=r"attitude\.csv: cannot be read .*; run task=attitude"):
        AttitudeEvidence([read_run(run)])
