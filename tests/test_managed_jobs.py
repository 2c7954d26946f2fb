"""Runs under somebody's management: signals and ranks in the environment, a small shared memory."""

import os
import signal
import subprocess
import sys
import time

import pytest
import torch

from src.results.files import read_results
from tests.sessions import ONE_THREAD, ROOT
from tests.synthetic import compose_config, mini_overrides, write_dataset

SLURM = {
    "SLURM_JOB_ID": "7",
    "SLURM_JOB_NAME": "t",
    "SLURM_NTASKS": "1",
    **{f"SLURM_{name}": "0" for name in ("PROCID", "LOCALID", "NODEID")},
}
QUICK = ("+experiment=skyocc", "trainer.accelerator=cpu", "~callbacks.preview")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("managed")
    write_dataset(compose_config(*mini_overrides(folder)))
    return folder


def started(place, tmp_path, *overrides, **environment):
    """The program, with runs of its own beside the shared data."""
    words = [*mini_overrides(place), *QUICK, f"paths.runs={tmp_path}/runs", *overrides]
    return subprocess.Popen(
        [sys.executable, "run.py", *words],
        cwd=ROOT,
        env={**ONE_THREAD, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def ended(process, status=0):
    output = process.communicate(timeout=300)[0]
    assert process.returncode == status, output
    return output


def scores_of(run):
    return read_results(run / "results.csv").drop(columns=["seconds", "code_version", "git_commit"])


@pytest.mark.slow
def test_a_job_of_slurm_that_is_requeued_scores_its_own_best_weights(place, tmp_path):
    """Lightning left `hpc_ckpt_1.ckpt` in the run's folder, and scored that one ever after."""
    words = ("trainer.max_epochs=3",)
    run = tmp_path / "runs/tiny/skyocc/seed0"
    process = started(place, tmp_path, *words, **SLURM)
    while not (run / "checkpoints/last.ckpt").is_file():
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.05)
    process.send_signal(signal.SIGUSR1)
    assert "the system ended the program" in ended(process, status=143)
    assert not list(run.rglob("hpc_ckpt*"))

    ended(started(place, tmp_path, *words, **SLURM))
    undisturbed = tmp_path / "undisturbed"
    ended(started(place, undisturbed, *words))
    expected = scores_of(undisturbed / "runs/tiny/skyocc/seed0")
    assert scores_of(run).equals(expected)

    # Nor is a file that an older version left there taken for the weights that are named.
    left = torch.load(run / "checkpoints/last.ckpt", weights_only=True)
    left["state_dict"] = {name: 0 * each for name, each in left["state_dict"].items()}
    torch.save(left, run / "hpc_ckpt_9.ckpt")
    best = f'ckpt_path="{run}/checkpoints/best.ckpt"'
    ended(started(place, tmp_path, "task=test", best, **SLURM))
    assert scores_of(run / "test").equals(expected)


@pytest.mark.slow
@pytest.mark.parametrize("variable", ["RANK", "LOCAL_RANK", "SLURM_PROCID"])
def test_a_stray_rank_in_the_environment_leaves_a_whole_run(place, tmp_path, variable):
    """It trained, kept nothing, and ended with status 0."""
    ended(started(place, tmp_path, "+debug=fast", **{variable: "1"}))
    (results,) = tmp_path.glob("runs/**/results.csv")
    assert (results.parent / "metrics.csv").is_file()
    assert (results.parent / "checkpoints/best.ckpt").is_file()


@pytest.mark.slow
@pytest.mark.skipif(os.getuid() != 0, reason="only root can mount a shared memory of its own")
def test_a_small_shared_memory_is_told_in_a_line(place, tmp_path):
    words = [*mini_overrides(place), *QUICK, f"paths.runs={tmp_path}/runs", "data.workers=1"]
    inside = 'mount -t tmpfs -o size=64k tmpfs /dev/shm && exec "$@"'
    command = ["unshare", "-m", "sh", "-c", inside, "sh", sys.executable, "run.py", *words]
    done = subprocess.run(command, cwd=ROOT, env=ONE_THREAD, capture_output=True, text=True)
    if "unshare" in done.stderr or "mount" in done.stderr:
        pytest.skip(f"no file system of one's own here: {done.stderr.strip()}")
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error: shared memory (/dev/shm) is too small")
