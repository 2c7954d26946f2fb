"""A very small dataset from the real generator, made once for all tests that need one."""

import errno
import gc
import logging
import os
import runpy
import sys

import jaxtyping
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from tests.annotations import check_annotations
from tests.sessions import ROOT

check_annotations()  # before anything of src is imported

if "OMP_NUM_THREADS" not in os.environ:
    # The threads of two processes on two cores would wait for each other most of the time.
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def mini_config(tmp_path_factory):
    from tests.synthetic import generated_config  # only here: Lightning takes seconds to import

    return generated_config(tmp_path_factory.mktemp("generated"), workers=2)


@pytest.fixture
def mini_sim(mini_config):
    """The composed ``sim`` configuration of the smallest dataset; yours to change."""
    return OmegaConf.to_container(mini_config.sim, resolve=True)


@pytest.fixture(scope="session")
def mini_dataset(mini_config):
    """The root of two generated clips of 30 frames with aux images; not to be changed."""
    from src.tasks.dataset import make_dataset, root_of

    make_dataset(mini_config)
    return root_of(mini_config)


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
