"""The refusals where a renderer cannot run, and the silence of Bullet itself."""

import os
import subprocess
import sys

import pytest

from src.errors import UserError
from src.sim import renderer
from src.sim.renderer import require_renderer, silent

NOBODYS = "libEGL-that-nobody-has.so.1"


@pytest.fixture
def loadable(monkeypatch):
    """Any library but `NOBODYS` can be loaded, whether this machine has it or not."""
    load = renderer.ctypes.CDLL
    missing = {NOBODYS: NOBODYS}
    monkeypatch.setattr(renderer.ctypes, "CDLL", lambda name: load(missing.get(name)))
    renderer._egl_fault.cache_clear()
    yield
    renderer._egl_fault.cache_clear()


def refusal(name):
    with pytest.raises(UserError) as error:
        require_renderer(name)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("sim.renderer: ")
    return message


def test_an_unknown_renderer_is_refused_with_those_that_there_are():
    message = refusal("blender")
    assert "'blender'" in message
    assert "tiny, egl" in message


@pytest.mark.parametrize(
    ("constant", "value", "named"),
    [
        ("EGL_LIBRARY", NOBODYS, [NOBODYS, "libegl1", "sim.renderer=tiny"]),
        ("EGL_PLUGIN", "a_plugin_that_nobody_has", ["a_plugin_that_nobody_has"]),
        # A probe that dies is a refusal and no crash.
        ("_DRAW_ONE_TRIANGLE", "import os; os.abort()", ["libgl1-mesa-dri"]),
    ],
)
def test_without_what_egl_needs_its_name_is_given(loadable, monkeypatch, constant, value, named):
    monkeypatch.setattr(renderer, constant, value)
    message = refusal("egl")
    assert all(name in message for name in named)


def test_bullet_is_imported_in_silence_and_what_c_held_back_is_not_printed_after_all(monkeypatch):
    code = "import ctypes; from src.sim.renderer import import_bullet, silent\nimport_bullet()\n"
    code += "with silent(): ctypes.CDLL(None).puts(b'during')"
    # Where Python does not hold its output back, C does not either.
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == done.stderr == b""


def test_silence_ends(capfd):
    os.write(1, b"before\n")
    with silent():
        os.write(1, b"during\n")
        os.write(2, b"during\n")
    os.write(1, b"after\n")
    assert capfd.readouterr() == ("before\nafter\n", "")
