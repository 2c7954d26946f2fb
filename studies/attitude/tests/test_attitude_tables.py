"""Scores by tilt and under a wrong attitude, of several runs together."""

import pytest

from src.report.ladder import PAPER
from src.results.counts import Counts
from src.results.runs import read_run
from studies.attitude.conditions import read_conditions
from studies.attitude.figure import draw_report_attitude
from studies.attitude.tables import AttitudeScores, attitude_tables
from studies.attitude.tests.presented import write_attitude
from studies.attitude.tests.test_conditions import rewrite
from tests.results.scored import write_run

SEEDS = (0, 1)
ABOVE = "+ Attitude-aware projection"


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    folders = {}
    for name, gain in {"baseline": 0.0, "attitude": 0.4}.items():
        for seed in SEEDS:
            folders[name, seed] = write_run(runs, name, seed)
            write_attitude(folders[name, seed], gain, seed)
    # It was not scored so.
    folders["weights", 0] = write_run(runs, "weights")
    return folders


def scores_of(*folders):
    return AttitudeScores.of(read_conditions([read_run(path) for path in folders]), PAPER)


@pytest.fixture(scope="module")
def attitude(folders):
    return scores_of(*folders.values())


def by_hand(folders, name, condition):
    """KAR-mIoU in percent, a seed at a time."""
    files = [folders[name, seed] / f"attitude/tallies/{condition}.npz" for seed in SEEDS]
    return [100 * float(Counts.read(file).scores("occupancy")["kar_miou"]) for file in files]


def names(table):
    return [name for name, _ in table.rows]


def test_tables_have_scores_and_below_them_the_changes(attitude):
    tilt, level, faults = attitude_tables(attitude)
    assert [each.key for each in (tilt, level, faults)] == [
        *("attitude_tilt", "attitude_level", "attitude_faults")
    ]
    assert tilt.columns == ["0–5° (2 frames)", "from 5° (5 frames)"]
    assert level.columns == ["all (7 frames)", *tilt.columns]
    assert faults.columns == [
        *("true", "3° noise", "0.2 s late", "distances 2 % too long", "times off by 10 ms")
    ]
    for table in (tilt, faults):
        assert names(table) == ["Baseline", ABOVE, f"{ABOVE}, over the baseline"]
    told = ["Baseline, over told level", f"{ABOVE}, over told level"]
    assert names(level) == ["Baseline", ABOVE, *told]
    assert {each.lines for each in (tilt, level, faults)} == {(2,)}
    assert [cell.signed for cell in tilt.rows[2][1]] == [True, True]


def test_a_gain_is_the_mean_of_the_differences_of_each_seed(attitude, folders):
    tilt, *_ = attitude_tables(attitude)
    gains = dict(zip(("tilt_0_5deg", "tilt_5_infdeg"), tilt.rows[2][1]))
    for condition, gain in gains.items():
        scores, references = (by_hand(folders, n, condition) for n in ("attitude", "baseline"))
        expected = sum(a - b for a, b in zip(scores, references)) / len(SEEDS)
        assert gain.value == pytest.approx(expected, abs=1e-4)
    assert gains["tilt_5_infdeg"].low > 0
    assert gains["tilt_0_5deg"][:3] == (0, 0, 0), "the same predictions"


def test_what_the_attitude_is_worth_is_of_the_same_frames_and_seeds(attitude, folders):
    _, level, _ = attitude_tables(attitude)
    for n, name in enumerate(("baseline", "attitude")):
        for true, worth in zip(("true", "tilt_0_5deg", "tilt_5_infdeg"), level.rows[2 + n][1]):
            told = "level" if true == "true" else f"level_{true}"
            scores, references = (by_hand(folders, name, each) for each in (true, told))
            expected = sum(a - b for a, b in zip(scores, references)) / len(SEEDS)
            assert worth.value == pytest.approx(expected, abs=1e-4)
    assert level.rows[3][1][1][:3] == (0, 0, 0), "the same predictions"
    assert worth.value > 5


def test_rows_of_the_figure_are_shares_beside_the_facts_of_their_conditions(attitude):
    _, level, faults = attitude_tables(attitude)
    rows = attitude.rows("attitude").set_index("condition")
    assert rows.loc["noise_3deg", "noise_deg"] == 3
    noise = dict(faults.rows)[ABOVE][faults.columns.index("3° noise")]
    assert 100 * rows.loc["noise_3deg", "value"] == pytest.approx(noise.value)
    worths = attitude.rows("attitude", "attitude", "level").set_index("part")
    assert set(worths.index) == {"test", "tilt_0_5deg", "tilt_5_infdeg"}
    assert not worths["level"].any()
    assert 100 * worths.loc["tilt_5_infdeg", "value"] == pytest.approx(level.rows[3][1][2].value)


def test_runs_without_a_common_seed_have_no_gains_and_are_drawn(folders, tmp_path):
    attitude = scores_of(folders["baseline", 0], folders["attitude", 1])
    assert draw_report_attitude(attitude, tmp_path / "attitude.png")
    assert (tmp_path / "attitude.png").is_file()
    tilt, *_ = attitude_tables(attitude)
    assert [row[0] is None for _, row in tilt.rows] == [False, False, True]


def test_runs_without_such_scores_have_no_table(folders):
    attitude = scores_of(folders["weights", 0])
    assert attitude.names([]) == []
    assert attitude_tables(attitude) == []


def test_runs_that_were_not_told_a_level_attitude_have_no_such_row_or_table(tmp_path):
    runs = [write_run(tmp_path, name) for name in ("baseline", "attitude")]
    for run in runs:
        write_attitude(run)
    rewrite(runs[1], lambda table: table[~table["level"]])
    _, level, _ = attitude_tables(scores_of(*runs))
    assert names(level) == ["Baseline", "Baseline, over told level"]
    rewrite(runs[0], lambda table: table[~table["level"]])
    keys = [table.key for table in attitude_tables(scores_of(*runs))]
    assert keys == ["attitude_tilt", "attitude_faults"]
