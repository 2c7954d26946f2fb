"""What many tests need and is slow to make: it is made once, for all of them."""

import copy
import errno
import gc
import logging
import os
import runpy
import shutil
import sys
from functools import cache
from importlib.metadata import distributions
from pathlib import Path

import jaxtyping
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from tests.annotations import SUITES, check_annotations
from tests.sessions import ROOT

check_annotations()  # before anything of src is imported

load_yaml = OmegaConf.load


@cache
def read_once(path, size, changed_ns):
    return load_yaml(path)


def read_from_memory(file):
    """Reads a file of a configuration as `OmegaConf.load` does, but parses it only once."""
    path = Path(file.name if hasattr(file, "read") else file)
    status = path.stat()
    return copy.deepcopy(read_once(path, status.st_size, status.st_mtime_ns))


OmegaConf.load = staticmethod(read_from_memory)

if "OMP_NUM_THREADS" not in os.environ:
    # The threads of two processes on two cores would wait for each other most of the time.
    torch.set_num_threads(1)


def pytest_runtest_setup(item):
    jaxtyping.config.update("jaxtyping_disable", item.path.parent.name not in SUITES)


@pytest.fixture(scope="session")
def mini_config(request):
    """The configuration of a very small dataset of the real generator.

    It lies in pytest's cache, for the next session too. Its own folder is named after the code that
    makes the clips; the code and the packages that this name leaves out name the folder above.
    """
    from src.provenance import digest_of
    from tests.synthetic import generated_config  # only here: Lightning takes seconds to import

    packages = sorted(f"{each.name} {each.version}" for each in distributions())
    code = [path.read_text() for path in sorted((ROOT / "src/data").glob("*.py"))]
    name = f"generated-{digest_of([packages, code])}"
    return generated_config(request.config.cache.mkdir(name), workers=2)


@pytest.fixture
def mini_sim(mini_config):
    """The composed ``sim`` configuration of the smallest dataset; yours to change."""
    return OmegaConf.to_container(mini_config.sim, resolve=True)


@pytest.fixture(scope="session")
def mini_dataset(mini_config):
    """The root of two generated clips of 30 frames with aux images; not to be changed.

    The generator writes each file under another name first, so what an interrupted session leaves
    is completed; what a test has damaged is made anew.
    """
    from src.data.clip import damaged_files
    from src.locks import locked
    from src.tasks.dataset import ready_dataset, root_of

    root = root_of(mini_config)
    with locked(root.with_suffix(".lock"), on_wait=lambda: None):
        if any(damaged_files(clip) for clip in root.glob("*/clip*")):
            shutil.rmtree(root)
        return ready_dataset(mini_config)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """``made_once(name, make)`` -> a folder that one worker fills for all; not to be changed."""
    from src.locks import locked

    # xdist gives each worker a folder within that of the session.
    session = tmp_path_factory.getbasetemp()
    session = session.parent if "PYTEST_XDIST_WORKER" in os.environ else session

    def filled(name, make):
        folder, done = session / name, session / f"{name}.done"
        with locked(session / f"{name}.lock", on_wait=lambda: None):
            if not done.exists():
                make(folder)
                done.touch()
        return folder

    return filled


@pytest.fixture
def unchecked():
    """Annotations are not checked: for what the code itself refuses, as it does for a user."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def no_locks(monkeypatch):
    """A file system that knows no file locks."""

    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", flock)


@pytest.fixture
def run_py(monkeypatch, capsys, unchecked):
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
    gc.enable()
    gc.unfreeze()
    GlobalHydra.instance().clear()
    logging.disable(logging.NOTSET)
