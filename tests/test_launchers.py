"""Hydra's launchers: the cluster's configuration composes, and each job is a process of its own."""

import subprocess
import sys

import pytest
from hydra import compose, initialize_config_dir

from src.data.manifest import MANIFEST
from src.sweep import launcher_failure
from tests.sessions import ONE_THREAD, ROOT, python
from tests.synthetic import CONF


def test_the_slurm_configuration_composes():
    overrides = ["hydra/launcher=slurm", "hydra.launcher.partition=cpu"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("config", overrides, return_hydra_config=True)
    launcher = cfg.hydra.launcher
    assert launcher._target_.endswith("SlurmLauncher")
    assert (launcher.partition, launcher.cpus_per_task, launcher.nodes) == ("cpu", 8, 1)


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_shards_spread_by_a_launcher_make_one_dataset(launcher, tmp_path):
    overrides = [
        *("-m", "task=generate", "scale=tiny", f"hydra/launcher={launcher}", "sim.shards=2"),
        *("sim.shard=0,1", "sim.clips_per_town=1", "sim.capture_hz=2.5", "data.history_step_s=0.4"),
        *("data.test_clips=[]", f"paths.data={tmp_path}/data", f"paths.runs={tmp_path}/runs"),
    ]
    python("run.py", *overrides)
    (root,) = (tmp_path / "data").glob("tiny-*")
    assert (root / MANIFEST).is_file()
    assert len(list(root.glob("*/clip00"))) == 2
    assert not list((tmp_path / "data").glob(".*"))


@pytest.mark.slow
def test_jobs_of_a_launcher_find_this_project_from_any_folder(tmp_path):
    """They failed with a trace, whose cause, `No module named 'src'`, was cut."""
    words = ["-m", "hydra/launcher=submitit_local", "task=generate", "scale=tiny"]
    words += ["sim.dry_run=true", "sim.seed=0,1", "paths.runs=runs"]
    command = [sys.executable, str(ROOT / "run.py"), *words]
    done = subprocess.run(
        command, cwd=tmp_path, env=ONE_THREAD, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "sim.seed=1: finished" in done.stdout


def test_the_last_line_of_a_launcher_s_trace_is_shown():
    """As submitit says it of a job that could not begin, and of one that was killed."""
    trace = (
        "Job (task=0) failed during processing with trace:\n----------------------\n"
        'Traceback (most recent call last):\n  File "x.py", line 1\n'
        "ModuleNotFoundError: No module named 'src'\n\n----------------------\n"
        "You can check full logs with 'job.stderr(0)' and 'job.stdout(0)'or at paths:\n  - /a/0.err"
    )
    message = str(launcher_failure(RuntimeError(trace)))
    assert (
        "failed during processing with trace: ModuleNotFoundError: No module named 'src'" in message
    )
    killed = "Job 7 (task: 0) has not produced any output (state: OUT_OF_MEMORY)\n"
    killed += "Error stream produced:\n---\nslurmstepd: error: Detected 1 oom-kill event(s)"
    message = str(launcher_failure(RuntimeError(killed)))
    assert "OUT_OF_MEMORY" in message
    assert "oom-kill" in message
