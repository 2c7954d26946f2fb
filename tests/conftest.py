"""A very small dataset from the real generator, made once for all tests that need one."""

import copy
import errno
import logging
import os
import runpy
import sys

import pytest
import torch
from hydra.core.global_hydra import GlobalHydra

from src.data.manifest import DatasetSpec, write_manifest
from src.data.rates import frames_per_clip
from src.data.split import make_split
from src.sim.generate import generate
from src.sim.plan import plan_clips
from tests.sessions import ROOT
from tests.sim.weathers import VALUES

if "OMP_NUM_THREADS" not in os.environ:
    # The threads of two processes on two cores would wait for each other most of the time.
    torch.set_num_threads(1)

MINI_SIM = {
    "seed": 0,
    "towns": ["suburb"],
    "clips_per_town": 2,
    "weathers": ["clear", "rain"],
    "weather": VALUES,
    "capture_hz": 2.5,
    "lidar_hz": 2.5,
    "lidar_rays": 4000,
    "range_m": 60.0,
    "camera_stride": 2,
    "renderer": "tiny",
    "image": {"width": 96, "height": 64, "hfov_deg": 90.0},
    "camera": {"position_m": [0.1, 0.0, -0.05], "pitch_deg": 0.0},
    "grid": {"lower_m": [0.0, -25.0, -20.0], "upper_m": [50.0, 25.0, 10.0], "shape": [25, 25, 15]},
    "flight": {},
    "traffic": {},
    "save_aux": True,
    "workers": 2,
    "shards": 1,
    "shard": 0,
    "dry_run": False,
}


@pytest.fixture
def mini_sim():
    """The composed ``sim`` configuration of the smallest dataset; yours to change."""
    return copy.deepcopy(MINI_SIM)


@pytest.fixture(scope="session")
def mini_dataset(tmp_path_factory):
    """The root of two generated clips of 30 frames with aux images; not to be changed."""
    spec = DatasetSpec.of("mini", MINI_SIM)
    root = spec.root(tmp_path_factory.mktemp("generated"))
    generate(MINI_SIM, root)
    clip_ids = [plan.clip_id for plan in plan_clips(MINI_SIM)]
    frames, capture_hz = frames_per_clip(MINI_SIM["capture_hz"]), MINI_SIM["capture_hz"]
    split = make_split(clip_ids, frames, capture_hz, [], clip_ids[-1:])
    write_manifest(root, spec, clip_ids, split)
    return root


@pytest.fixture
def no_locks(monkeypatch):
    """A file system that knows no file locks."""

    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", flock)


@pytest.fixture
def run_py(monkeypatch, capsys):
    """Runs ``run.py`` in this process; returns its status, its lines and those of its errors."""

    def called(*overrides):
        GlobalHydra.instance().clear()
        monkeypatch.setattr(sys, "argv", ["run.py", *overrides])
        status = 0
        try:
            runpy.run_path(str(ROOT / "run.py"), run_name="__main__")
        except SystemExit as stop:
            status = stop.code

        output = capsys.readouterr()
        return status, output.out.splitlines(), output.err.splitlines()

    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    yield called
    GlobalHydra.instance().clear()
    logging.disable(logging.NOTSET)
