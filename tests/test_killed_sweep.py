"""The same scores, curves and tables, to the last bit: whatever kills a sweep, or runs it."""

import os
import re
import signal
import time

import numpy as np
import pandas as pd
import pytest

from src.results.files import read_results
from src.tasks.fit import SKIPPED
from src.tasks.report import report
from tests import sessions
from tests.synthetic import MINI, compose_config

RUNGS = ("baseline", "skyocc")
# ``run.py`` with a smaller figure.
PROGRAM = """
import runpy
from src.tasks import evaluate
evaluate.SHOWN_FRAMES = 1
if __name__ == "__main__":
    runpy.run_path("run.py", run_name="__main__")
"""


def start(folder, *overrides):
    """The sweep as a program of its own, which makes its own data."""
    places = f"paths.data={folder}/data", f"paths.runs={folder}/runs"
    sweep = "-m", f"+experiment={','.join(RUNGS)}", "trainer.accelerator=cpu"
    return sessions.start("-c", PROGRAM, *sweep, *MINI, *places, *overrides)


def output_of(process):
    """All that a sweep prints, once it has ended well."""
    try:
        output = process.communicate(timeout=1200)[0]
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    assert process.returncode == 0, output
    return output


def kill_in(stage, delay_s, process):
    """Kills a sweep and all its processes, so many processor seconds after a stage has begun."""
    begun_s = None
    while begun_s is None or sessions.spent_s(process.pid) - begun_s < delay_s:
        assert process.poll() is None, process.communicate()[0]
        if begun_s is None and stage():
            begun_s = sessions.spent_s(process.pid)
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def what_came_out(folder):
    """Scores and curves of every rung; how long it took is left out."""
    runs = [folder / f"runs/tiny/{rung}/seed0" for rung in RUNGS]
    results = [read_results(run / "results.csv").drop(columns="seconds") for run in runs]
    tables = [pd.read_csv(run / name) for run in runs for name in ("scores.csv", "metrics.csv")]
    return [*results, *tables]


def tables_of(folder):
    """The tables of a report, byte by byte."""
    cfg = compose_config("task=report", "scale=tiny", f"paths.runs={folder}/runs")
    report(cfg, [], str(folder / "report"), scenes=0)
    return [(folder / "report" / name).read_bytes() for name in ("tables.csv", "tables.tex")]


def require_same(left, right):
    for table, other in zip(what_came_out(left), what_came_out(right), strict=True):
        pd.testing.assert_frame_equal(table, other, check_exact=True)
    assert tables_of(left) == tables_of(right)


def outcomes(output):
    """The closing line of every job."""
    return [
        line.partition(": ")[2] for line in output.splitlines() if re.match("experiment=.*: ", line)
    ]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The folder of a whole sweep."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert outcomes(output_of(start(folder))) == ["finished", "finished"]
    return folder


@pytest.mark.slow
def test_killed_at_three_random_moments_it_ends_as_if_undisturbed(undisturbed, tmp_path):
    """Soon after the start, with the first rung in training, and with the last one."""
    # What a run goes on from; best.ckpt is there a moment earlier.
    kept = [tmp_path / f"runs/tiny/{rung}/seed0/checkpoints/last.ckpt" for rung in RUNGS]
    stages = [lambda: True, kept[0].is_file, kept[1].is_file]
    # Longest for the first stage: a start alone takes seconds, the rest of a training little more.
    delays_s = np.random.default_rng(0).uniform(0, [10, 2, 2])

    for stage, delay_s in zip(stages, delays_s, strict=True):
        kill_in(stage, delay_s, start(tmp_path))
    first, last = outcomes(output_of(start(tmp_path)))
    # Otherwise nothing of what was there had been used.
    assert first == SKIPPED
    assert "went on after epoch" in last
    require_same(tmp_path, undisturbed)
    assert outcomes(output_of(start(tmp_path))) == [SKIPPED, SKIPPED]
    assert not list(tmp_path.rglob("*.before*"))
    assert not list(tmp_path.rglob("*.tmp"))


@pytest.mark.slow
def test_two_jobs_at_once_come_out_as_one_after_the_other(undisturbed, tmp_path):
    """Both need the dataset, and one of them makes it."""
    launcher = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "data.workers=1")
    output = output_of(start(tmp_path, *launcher))
    assert outcomes(output) == ["finished", "finished"]
    assert "another process is making" in " ".join(output.split())
    require_same(tmp_path, undisturbed)
