"""The parts that other projects use, under the project's own name."""

import subprocess
import sys

from tests.sessions import ROOT

SCRIPT = """
import sys
import numpy as np
from skyshield.geometry import VoxelGrid
from skyshield.metrics import KARMeanIoU
from skyshield.models.stream import SkyOccStream
import src

score = KARMeanIoU(VoxelGrid(shape=(25, 25, 15)))
labels = np.zeros((1, 25, 25, 15), np.uint8)
score.update(labels, labels, np.array([5.0]))
assert score.compute() == 1
stream = SkyOccStream.of(sys.argv[1])
assert type(stream.network).__module__ == "skyshield.models.network"
assert src.OF_ANOTHER_PROJECT and not [name for name in sys.modules if name.startswith("src.")]
"""


def test_they_are_imported_from_anywhere_beside_a_src_of_another_project(tmp_path):
    (tmp_path / "src").mkdir()
    (tmp_path / "src/__init__.py").write_text("OF_ANOTHER_PROJECT = True\n")
    (weights,) = (ROOT / "weights").glob("*.ckpt")
    command = [sys.executable, "-c", SCRIPT, str(weights)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
