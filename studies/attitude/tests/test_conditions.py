"""Conditions of the attitude: which frames they hold, and which counts may stand together."""

import dataclasses
import math
import shutil

import pandas as pd
import pytest
import torch

from src.errors import UserError
from src.metrics import OccupancyScores
from src.metrics.protocol import SUPERVISED, Protocol
from src.results.counts import Counts
from src.results.runs import read_run
from studies.attitude.conditions import LATER, Condition, conditions_of, read_conditions
from studies.attitude.measured_poses import Fault
from studies.attitude.task import narrowed
from studies.attitude.tests.presented import write_attitude
from studies.counting import ClipCounts
from tests.results.scored import CLIPS, FRAMES, GRID, counts, protocol, write_run


def batch_of(roll_deg, pitch_deg, clips):
    generator = torch.Generator().manual_seed(0)
    attitude_deg = torch.tensor([roll_deg, pitch_deg]).T.float()
    return {
        "attitude_rad": torch.deg2rad(attitude_deg),
        "clip": clips,
        "semantics": torch.randint(9, (len(clips), *GRID.shape), generator=generator).byte(),
        "velocity_mps": torch.full((len(clips), 3), 2.0),
    }


def read(*runs):
    return read_conditions([read_run(run) for run in runs])


# ---------------------------------------------------------------------------------- their frames


def test_bins_of_tilt_share_all_frames_among_them():
    conditions = list(conditions_of([5, 10], [], [], False))
    names = ["true", "tilt_0_5deg", "tilt_5_10deg", "tilt_10_infdeg"]
    assert [each.name for each in conditions] == names
    batch = batch_of([0, -3, 4, -9], [0, 3, -5, 8], ["a/0"] * 4)
    held = torch.stack([each.holds(batch) for each in conditions])
    assert held[0].all()
    assert held[1:].int().tolist() == [[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 1]]


def test_faults_follow_and_then_all_frames_and_each_bin_of_level_flight():
    conditions = list(conditions_of([5], [1.0, 3.0], [0.1], True, [0.02], [0.01]))
    assert [each.name for each in conditions] == [
        *("true", "tilt_0_5deg", "tilt_5_infdeg", "noise_1deg", "noise_3deg", "delay_0.1s"),
        *("distance_2pct", "time_0.01s"),
        *("level", "level_tilt_0_5deg", "level_tilt_5_infdeg"),
    ]
    assert len({each.fault for each in conditions}) == 7
    assert conditions[6].fault == Fault(distance_off=0.02)
    assert conditions[7].fault == Fault(time_off_s=0.01)
    last = conditions[-1]
    assert (last.presented, last.part) == ("level", "tilt_5_infdeg")
    assert (conditions[1].presented, conditions[3].part) == ("true", "test")
    batch = batch_of([0, -6], [0, 0], ["a/0"] * 2)
    assert last.holds(batch).tolist() == [False, True], "by the true tilt"


@pytest.mark.parametrize(
    ("values", "key"),
    [
        (([10, 5], [], []), "tilt_edges_deg"),
        (([0], [], []), "tilt_edges_deg"),
        (([math.nan], [], []), "tilt_edges_deg"),
        (([], [0.0], []), "noise_deg"),
        (([], [], [-0.1]), "delay_s"),
        (([], [], [], False, [-0.02]), "distance_off"),
        (([], [], [], False, [], [0.0]), "time_off_s"),
        (([], [], [math.inf]), "delay_s"),
        (([], [3.0, 3.0], []), "noise_deg"),
        (([], [], [0.1, 0.10000001]), "delay_s"),
        (([5.0, 5.0000001], [], []), "tilt_edges_deg"),
    ],
)
def test_values_that_make_no_sense_are_refused(values, key):
    with pytest.raises(UserError, match=rf"task\.{key}: .*; give "):
        list(conditions_of(*values[:3], *(values[3:] or [False])))


def test_the_counts_of_the_bins_add_up_to_those_of_all_frames():
    conditions = list(conditions_of([5, 10], [], [], False))
    counters = {
        each: ClipCounts(each.name, OccupancyScores(GRID), CLIPS[:2]) for each in conditions
    }
    batch = batch_of([0, 6, 4, 20], [0, 0, 4, 0], [*CLIPS[:1] * 2, *CLIPS[1:2] * 2])
    for condition, counter in counters.items():
        counter.add(batch, batch["semantics"].roll(1, dims=1), condition.holds(batch))
    of_all = Protocol.of("data", "test", 4, GRID, SUPERVISED, {}, {})
    whole, *bins = narrowed(counters, of_all)
    assert whole.frames == [2, 2]
    assert [each.frames for each in bins] == [[1, 0], [1, 1], [0, 1]]
    assert (bins[1].protocol.part, bins[1].protocol.frames) == ("test, tilt_5_10deg", 2)
    for name, table in whole.tables["occupancy"].items():
        assert sum(each.tables["occupancy"][name] for each in bins).equal(table)


# ------------------------------------------------------------------- which may stand in one table


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for name in ("baseline", "attitude"):
        write_attitude(write_run(folder, name))
    return folder


@pytest.fixture
def pair(written, tmp_path):
    """A baseline and an attitude run, each with scores by attitude; yours to change."""
    runs = shutil.copytree(written, tmp_path / "runs")
    return [runs / name / "seed0" for name in ("baseline", "attitude")]


def rewrite(run, change):
    """Puts ``change(table)`` in the place of a run's ``attitude.csv``."""
    path = run / "attitude/attitude.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)


def without(condition):
    return lambda table: table[table["condition"] != condition]


def test_the_counts_of_each_condition_are_read_by_experiment_and_seed(pair):
    conditions = read(*pair)
    assert Condition() in conditions
    assert Condition(5.0, level=True) in conditions
    assert len(conditions) == 10
    assert {name: list(seeds) for name, seeds in conditions[Condition()].items()} == {
        **{"baseline": [0], "attitude": [0]}
    }
    assert conditions[Condition(noise_deg=3.0)]["attitude"][0].name == "noise_3deg"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda table: table.assign(noise_seed=1), ".*noise_seed=1, .*elsewhere 0; sco"),
        (without("tilt_0_5deg"), "has other bins of tilt than "),
        (lambda table: table[["condition"]], "cannot be read .*; run task=attitude"),
    ],
)
def test_a_table_of_other_conditions_or_of_none_is_refused(pair, change, message):
    rewrite(pair[1], change)
    with pytest.raises(UserError, match=rf"attitude\.csv: {message}"):
        read(*pair)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"protocol": protocol("tiny-4567")}, r"noise_3deg\.npz: .*dataset=tiny-4567"),
        ({"clips": [f"x/{n}" for n in range(len(CLIPS))]}, r"other clips or frames than "),
        ({"frames": FRAMES[::-1]}, r"other clips or frames than "),
        ({"tables": counts("x", lambda target, n: target, labels=1).tables}, r"other labels than "),
    ],
)
def test_scores_of_other_frames_are_refused(pair, change, message):
    path = pair[1] / "attitude/tallies/noise_3deg.npz"
    dataclasses.replace(Counts.read(path), **change).write(path)
    with pytest.raises(UserError, match=message):
        read(*pair)


def test_scores_under_other_settings_than_the_run_s_are_refused(pair):
    path = pair[1] / "attitude/tallies/true.npz"
    dataclasses.replace(Counts.read(path), protocol=protocol(horizon_s=4.0)).write(path)
    with pytest.raises(UserError, match=r"metric\.horizon_s=.*score both alike"):
        read(pair[1])


@pytest.mark.parametrize(("voxels", "accepted"), [(100_000, True), (1_000, False)])
def test_another_machine_may_tip_one_voxel_of_many(pair, voxels, accepted):
    run, path = read_run(pair[0]), pair[0] / "attitude/tallies/true.npz"
    tipped = Counts.read(path)
    for each in (run.counts, tipped):
        each.tables["occupancy"]["count"][0, 0, 0] = voxels
    tipped.tables["occupancy"]["count"][0, 0] += torch.tensor([-1, 1, *[0] * 7])
    tipped.write(path)
    if accepted:
        assert read_conditions([run])
    else:
        with pytest.raises(UserError, match=r"true\.npz: counts .* % of the voxels other"):
            read_conditions([run])


def test_seeds_of_one_experiment_have_the_same_conditions(tmp_path):
    runs = [write_attitude(write_run(tmp_path, "skyocc", seed)).parent for seed in (0, 1)]
    rewrite(runs[1], without("noise_3deg"))
    with pytest.raises(UserError, match=r"seed1.*other conditions than .*seed0.* \(noise_3deg\)"):
        read(*runs)


@pytest.mark.parametrize("alone", [True, False])
def test_a_condition_without_its_counts_is_one_line(pair, alone):
    (pair[1] / "attitude/tallies/delay_0.2s.npz").unlink()
    with pytest.raises(UserError, match=r"delay_0\.2s\.npz: .*run task=attitude again"):
        read(*pair[alone:])


def test_tables_from_before_distances_and_times_could_be_off_are_read(pair):
    later = "distance_2pct", "time_0.01s"
    rewrite(pair[0], lambda table: table[~table["condition"].isin(later)].drop(columns=[*LATER]))
    conditions = read(pair[0])
    assert len(conditions) == 8
    assert {each.fault for each in conditions} == {
        *(Fault(), Fault(noise_deg=3.0), Fault(delay_s=0.2), Fault(level=True))
    }
    assert set(read(*pair)) > set(conditions), "beside one that has them"


def test_the_true_attitude_may_be_the_only_condition(pair):
    # "true" in every row of a column is no truth value.
    rewrite(pair[0], lambda table: table[table["condition"] == "true"])
    assert list(read(pair[0])) == [Condition()]
