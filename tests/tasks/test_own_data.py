"""Every command of ``docs/own_data.md``, in its order, on one small flight."""

import re
import shlex
from pathlib import Path

import pytest

from src.data.clip import Clip
from src.data.manifest import read_manifest
from tests.recordings import foreign
from tests.sessions import ROOT
from tests.tasks.test_watch import write_flight

PAGE = ROOT / "docs/own_data.md"
SMALL = ("threads=1", "trainer.accelerator=cpu")
# A flight of 2.5 Hz, seen by the smallest network.
TINY = ("scale=tiny", "trainer.max_epochs=1", "+trainer.limit_train_batches=2", "data.batch_size=2")
TINY += ("data.history_step_s=0.4", "data.parallax.ages_s=[0.4,0.8]", "sim.workers=1")


def commands():
    blocks = re.findall(r"```bash\n(.*?)```", PAGE.read_text(), re.S)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


@pytest.fixture
def here(mini_dataset, tmp_path, monkeypatch):
    """A folder with a recording of one of our clips, and a film of another flight."""
    first = next(iter(read_manifest(mini_dataset)["clips"]))
    foreign.write_plain(Clip(mini_dataset / first), tmp_path / "my_flights/first")
    write_flight(tmp_path, hfov_deg=84)
    (tmp_path / "weights").symlink_to(ROOT / "weights")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_the_commands_of_the_page_work_one_after_the_other(here, run_py):
    dataset = "data/my_flights-0123456789ab"
    for line in commands():
        words = shlex.split(line)
        assert words[:2] == ["python", "run.py"], line
        made = [str(path) for path in Path("data").glob("my_flights-*")]
        words = [word.replace(dataset, *made) if dataset in word else word for word in words[2:]]
        if "task=watch" not in words:
            words += TINY
            # From here on the configured dataset is the recording's.
            if made and not any(word.startswith("paths.dataset") for word in words):
                words.append(f"paths.dataset={made[0]}")
        status, out, errors = run_py(*words, *SMALL)
        assert status == 0, (line, errors)
        assert out

    scored = (here / "exported/mine/scores/results.csv").read_text().splitlines()
    assert len(scored) == 2
    assert (here / "recorded").is_dir()
    assert list((here / "runs/watch/flight").glob("*.gif"))
