"""``run.py --help`` and the page of keys: short, quick, and true of the configuration."""

import re
import subprocess
import sys

import pytest
from omegaconf import OmegaConf

from src.help import KEYS, help_text
from tests.sessions import ROOT
from tests.synthetic import compose_config

PAGE = (ROOT / "docs/keys.md").read_text()
NAMED = [
    key
    for line in PAGE.splitlines()
    if line.startswith("| `")
    for key in re.findall(r"`([\w./]+)=?`", line.split("|")[1])
]


def is_there(key, cfg):
    """A group of options in conf/, or a key of the composed configuration."""
    missing = object()
    return (ROOT / "conf" / key).is_dir() or OmegaConf.select(cfg, key, default=missing) != missing


def test_it_is_short_and_names_every_task():
    lines = help_text().splitlines()
    assert len(lines) < 40
    assert max(map(len, lines)) <= 100
    for task in (ROOT / "conf/task").glob("*.yaml"):
        (line,) = [each for each in lines if each.startswith(f"  {task.stem} ")]
        assert len(line.split()) > 4


SCRIPT = """
import runpy, sys
try:
    runpy.run_path("run.py", run_name="__main__")
except SystemExit:
    print("imported:", *(name for name in ("torch", "hydra") if name in sys.modules))
"""


@pytest.mark.parametrize("word", ["--help", "-h"])
def test_it_imports_nothing_slow(word):
    command = [sys.executable, "-c", SCRIPT, word]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "imported:", done.stderr
    assert "Keys that people change" in done.stdout


def test_every_key_of_the_help_is_there():
    cfg = compose_config()
    keys = [key for words in KEYS for key in re.findall(r"([\w.+]+)=", words)]
    assert [key for key in keys if not is_there(key.lstrip("+"), cfg)] == []


def test_every_key_of_the_page_is_there():
    cfg = compose_config()
    assert len(NAMED) > 40
    assert [key for key in NAMED if not is_there(key, cfg)] == []
