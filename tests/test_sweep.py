"""A sweep as its user meets it: all jobs checked, all of them done, and told in the end."""

import errno
import os
import re
import signal
import time

import pytest

from src.sweep import labels_of, launcher_failure
from tests.sessions import running_in, start


@pytest.fixture
def sweep(run_py, tmp_path):
    """Runs ``run.py -m``; returns its status, its lines and those of its errors."""
    return lambda *overrides: run_py("-m", *overrides, f"paths.runs={tmp_path}/runs")


@pytest.fixture
def done(tmp_path):
    """Names of the jobs that a stub was called for."""
    return lambda: sorted(path.name for path in tmp_path.glob("runs/*") if path.is_file())


def stub(name):
    return f"task._target_=tests.stub_tasks.{name}"


# What a sweep says in the end whose second job meets a user's mistake, and whose third one a bug.
SUMMARY = [
    "seed=0: finished",
    "seed=1: failed: data.zip: broken; delete it",
    "seed=2: failed: ZeroDivisionError: division by zero",
    "seed=3: finished",
]

# -------------------------------------------------------------------------------- all jobs are done


def told(lines):
    """The lines with which jobs begin, and the others."""
    jobs = [line for line in lines if line.startswith("job ")]
    return jobs, [line for line in lines if line not in jobs]


def test_a_failing_job_does_not_stop_the_others(sweep, done, tmp_path):
    status, lines, errors = sweep(stub("fail_between_others"), "seed=0,1,2,3")
    assert status == 2
    assert done() == ["custom0", "custom3"]
    jobs, summary = told(lines)
    assert [line.partition(":")[0] for line in jobs] == [f"job {n} of 4" for n in (1, 2, 3, 4)]
    assert jobs[2].endswith(f"seed=2 paths.runs={tmp_path}/runs")
    assert summary == SUMMARY
    assert errors[0] == "error: data.zip: broken; delete it"
    assert "    return 1 / 0" in errors  # a bug keeps its traceback
    assert errors[-1].startswith("error: 2 of 4 jobs failed, for the reasons above; the same")


def test_a_job_sees_its_own_words_and_nothing_of_the_one_before(sweep, tmp_path):
    status, lines, errors = sweep(stub("be_one_of_many"), "seed=0,1")
    assert (status, errors) == (0, [])
    assert told(lines)[1][0] == "seed=0: finished, went on after epoch 1 of 2", (
        "what the task says of it"
    )
    for seed in (0, 1):
        typed = (tmp_path / f"runs/custom{seed}").read_text()
        assert typed == f"{stub('be_one_of_many')} seed={seed} paths.runs={tmp_path}/runs"
    assert "LOCAL_RANK" not in os.environ


def test_a_job_is_told_where_experiments_of_ones_own_lie(sweep, tmp_path):
    (tmp_path / "conf/experiment").mkdir(parents=True)
    text = "# @package _global_\ndefaults: [skyocc, _self_]\nname: mine\n"
    (tmp_path / "conf/experiment/mine.yaml").write_text(text)
    there = f"hydra.searchpath=[file://{tmp_path}/conf]"
    status, _, errors = sweep(stub("remember"), "+experiment=mine", "seed=0,1", there)
    assert (status, errors) == (0, [])
    # A process that Lightning starts for a second device composes these overrides.
    assert (tmp_path / "runs/mine1").read_text().startswith(f"{there} {stub('remember')} ")


def test_ctrl_c_ends_the_sweep_with_a_line(sweep, done):
    status, lines, errors = sweep(stub("be_interrupted"), "seed=0,1,2")
    assert status == 130
    assert done() == ["custom0"]
    assert told(lines)[1] == []
    assert errors == ["error: interrupted; the same command goes on from what is finished"]


def test_jobs_are_named_by_what_tells_them_apart():
    jobs = [["+experiment=a", "seed=0", "x=1"], ["+experiment=b", "seed=1", "x=1"]]
    assert labels_of(jobs) == ["experiment=a seed=0", "experiment=b seed=1"]
    assert labels_of(jobs[:1]) == ["experiment=a seed=0 x=1"]


# ------------------------------------------------------------------------------- checked beforehand


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (["+experiment=skyocc,baselin"], "'baseline'"),
        (["seed=0,1,-1"], "seed: -1 "),
        (["seed=0,1", "hydra/launcher=gnome"], "pip install -e '.[launchers]' or '.[ray]'"),
    ],
)
def test_a_mistake_in_any_job_is_told_before_the_first_one_starts(
    overrides, named, sweep, tmp_path
):
    status, lines, errors = sweep(stub("remember"), *overrides)
    assert (status, lines, len(errors)) == (2, [], 1)
    assert named in errors[0]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (["optimizer.lr=1e-3,1e-4"], r"paths\.run: 'optimizer\.lr=0\.001' .* both train"),
        (["ckpt_path=best", "task=attitude", "task.noise_deg=[1.0],[3.0]"], "both write"),
        (["ckpt_path=best", "task=test", "metric.horizon_s=4.0,5.0"], "both write"),
        (["ckpt_path=best,last", "task=calibrate"], "both write"),
        (["ckpt_path=best,last", "task=export"], "both write"),
    ],
)
def test_two_jobs_that_would_write_to_one_folder_are_refused(overrides, named, sweep, tmp_path):
    status, _, (line,) = sweep("+experiment=skyocc", *overrides)
    assert status == 2
    assert re.search(named, line)
    assert not list(tmp_path.iterdir())


def test_jobs_with_folders_of_their_own_are_checked_and_done(sweep, tmp_path):
    """The first thing that each meets is that there is no checkpoint."""
    for overrides in (
        ["ckpt_path=best", "task=predict", "task.part=test,val"],
        ["ckpt_path=best", "task=predict", f"predictions={tmp_path}/a,{tmp_path}/b"],
        ["ckpt_path=best", "task=export", "calibrated=true,false"],
    ):
        status, lines, errors = sweep("+experiment=skyocc", "scale=tiny", *overrides)
        assert status == 2
        assert len(told(lines)[0]) == 2, errors
        assert "would both" not in "".join(errors)


def test_a_place_that_is_no_folder_is_not_the_launchers_fault():
    error = launcher_failure(NotADirectoryError(errno.ENOTDIR, "Not a directory", "runs"))
    assert str(error).startswith("runs: not a folder; ")
    assert str(launcher_failure(RuntimeError("lost"))).startswith("hydra/launcher: RuntimeError: ")


# ----------------------------------------------------------------------------------- in processes


@pytest.fixture
def started(tmp_path):
    """Starts ``run.py -m`` as a program, and returns its process."""
    return lambda *overrides: start("run.py", "-m", *overrides, f"paths.runs={tmp_path}/runs")


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_under_a_launcher_of_processes_the_summary_is_the_same(launcher, done, started):
    process = started(stub("fail_between_others"), "seed=0,1,2,3", f"hydra/launcher={launcher}")
    lines = process.communicate(timeout=300)[0].splitlines()

    assert process.returncode == 2
    assert done() == ["custom0", "custom3"]
    assert [line for line in lines if line.startswith("seed=")] == SUMMARY
    assert lines[-1].startswith("error: 2 of 4 jobs failed")


@pytest.mark.slow
def test_a_launcher_that_loses_a_job_is_told_in_a_line(started):
    process = started(stub("be_killed"), "seed=0,1", "hydra/launcher=joblib")
    output = process.communicate(timeout=300)[0]
    told = r"^error: hydra/launcher: TerminatedWorkerError: .*the same command goes on"
    assert re.search(told, output, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("launcher", [[], ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]])
def test_ctrl_c_ends_it_at_once_and_leaves_nothing_running(launcher, done, started):
    process = started(stub("sleep"), "seed=0,1,2,3", *launcher)
    assert "asleep\n" in iter(process.stdout.readline, ""), "it ended before it slept"
    os.killpg(process.pid, signal.SIGINT)
    output = process.communicate(timeout=60)[0]
    assert process.returncode == 130
    assert output.splitlines()[-1] == (
        "error: interrupted; the same command goes on from what is finished"
    )
    assert len(done()) < 4
    time.sleep(1)
    assert not running_in(process.pid)
