"""A machine that cannot draw, as ARM under Linux: all but what draws data works there.

The packages are absent for a whole process and for those that it starts: nothing finds them.
"""

import subprocess
import sys

import pytest

from src.run_folder import SCORES
from tests.sessions import ONE_THREAD, ROOT
from tests.synthetic import compose_config, mini_overrides, write_dataset

RENDERERS = ("pybullet", "embreex")
# Of an extra, or of other people's files, which must not come in with what everybody needs.
EXTRAS = ("foxglove", "cv2")
# What trains and reports, and is not in docs/model.md's list of what a stream needs.
NOT_IN_FLIGHT = ("pandas", "PIL", "matplotlib", "plotly", "rich", "scipy", "transformers", "onnx")

HIDE = """
import os
import sys
from importlib.machinery import PathFinder

HIDDEN = os.environ["HIDDEN"].split()

class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in HIDDEN else super().find_spec(name, path, target)

    @classmethod
    def find_distributions(cls, context):  # other libraries ask for versions before they import
        return [] if context.name in HIDDEN else super().find_distributions(context)

sys.meta_path[sys.meta_path.index(PathFinder)] = Finder
"""
# Commands of run.py, one after the other in one process: most of its time goes into imports.
COMMANDS = """
import os, runpy, sys
from importlib.util import find_spec
from hydra.core.global_hydra import GlobalHydra
from src.tasks import evaluate

assert not any(map(find_spec, os.environ["HIDDEN"].split()))
evaluate.SHOWN_FRAMES = 1
for command in sys.argv[1].split(";"):
    GlobalHydra.instance().clear()
    sys.argv[1:] = command.split()
    try:
        runpy.run_path("run.py", run_name="__main__")
    except SystemExit as stop:
        print("status", stop.code, file=sys.stderr)
assert not [name for name in sys.modules if name.startswith(("src.sim.rays", "src.sim.scene"))]
"""
STREAM = """
import sys
import numpy as np
from src.models.stream import SkyOccStream, StreamFrame

pix_from_camera = np.array([[112.0, 0, 112], [0, 112, 64], [0, 0, 1]])
body_from_camera = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
stream, world_from_body = SkyOccStream.of(sys.argv[1]), np.eye(4)
world_from_body[2, 3] = 8
for n in range(2):
    image, velocity_mps = np.full((3, 128, 224), 40 * n, np.uint8), np.array([5.0, 0, 0])
    world_from_body[0, 3] = n
    way = world_from_body.copy(), velocity_mps
    logits = stream(StreamFrame(image, 0.2 * n, *way, pix_from_camera, body_from_camera))
assert logits.shape == (9, 50, 50, 30) and logits.isfinite().all()
assert not [name for name in sys.modules if name.startswith(("src.sim", "src.tasks"))]
"""


@pytest.fixture
def bare(tmp_path):
    """Runs a program where some packages cannot be found; returns how it ended."""
    (tmp_path / "sitecustomize.py").write_text(HIDE)

    def run(hidden, *words):
        own = {"PYTHONPATH": str(tmp_path), "HIDDEN": " ".join(hidden)}
        return subprocess.run(
            [sys.executable, "-c", *words],
            cwd=ROOT,
            env={**ONE_THREAD, **own},
            capture_output=True,
            text=True,
            timeout=1800,
        )

    return run


def commands(folder, *tasks):
    """Words of command lines, whose runs and data are in a folder."""
    shared = mini_overrides(folder, "+experiment=skyocc", "trainer.accelerator=cpu")
    return ";".join(" ".join([*shared, *task]) for task in tasks)


@pytest.mark.slow
def test_a_finished_dataset_is_trained_on_tested_predicted_and_scored(bare, tmp_path):
    root = write_dataset(compose_config(*mini_overrides(tmp_path)))
    run = tmp_path / "runs/tiny/skyocc/seed0"
    predictions = run / "predictions/test"

    once = ["trainer.max_epochs=1", f"paths.dataset={root}"]
    tasks = (
        once,
        [*once, "task=test", "ckpt_path=best"],
        [*once, "task=predict", "ckpt_path=best"],
        ["task=score", f"predictions={predictions}", f"dataset={root}"],
    )
    done = bare((*RENDERERS, *EXTRAS), COMMANDS, commands(tmp_path, *tasks))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    for folder in (run, predictions / "scores"):
        assert (folder / SCORES).is_file()


def test_what_draws_is_refused_in_one_line_before_anything_is_made(bare, tmp_path):
    done = bare(RENDERERS, COMMANDS, commands(tmp_path, ["task=generate"], [], ["task=fly"]))
    assert done.returncode == 0, done.stdout + done.stderr
    *lines, last = done.stderr.splitlines()
    assert [*lines[1::2], last] == ["status 2"] * 3
    for line in lines[::2]:
        assert line.startswith("error: embreex is not installed")
        assert "make setup" in line
        assert "paths.dataset" in line
    assert not any(tmp_path.rglob("*.zip"))


def test_a_stream_of_trained_weights_needs_little_more_than_torch(bare):
    (weights,) = (ROOT / "weights").glob("*.ckpt")
    done = bare((*RENDERERS, *EXTRAS, *NOT_IN_FLIGHT), STREAM, str(weights))
    assert done.returncode == 0, done.stderr
