"""Which renderers there are, and whether this machine has what they need."""

import ctypes
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Final

from ..errors import UserError

RENDERERS: Final = ("tiny", "egl")
"""TinyRenderer runs anywhere, on one core; EGL is faster on large images and needs the system's
OpenGL. They give other pixels, so a data set has one of them for all its clips."""

EGL_LIBRARY: Final = "libEGL.so.1"
EGL_PLUGIN: Final = "eglRenderer"

_DRAW_ONE_TRIANGLE = """
import sys, pathlib, tempfile, pybullet as bullet
bullet.connect(bullet.DIRECT)
assert bullet.loadPlugin(sys.argv[1], "_eglRendererPlugin") >= 0
with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder) / "triangle.obj"
    path.write_text("v -9 -9 -1\\nv 9 -9 -1\\nv 0 9 -1\\nvn 0 0 1\\nf 1//1 2//1 3//1\\n")
    shape = bullet.createVisualShape(bullet.GEOM_MESH, fileName=str(path))
    bullet.createMultiBody(0, -1, shape)
frustum = bullet.computeProjectionMatrix(-1, 1, -1, 1, 0.5, 9)
view = [float(i % 5 == 0) for i in range(16)]
flag = bullet.ER_BULLET_HARDWARE_OPENGL
assert bullet.getCameraImage(8, 8, view, frustum, renderer=flag)[3][4][4] < 1
"""
"""Run in a process of its own, because a failed load ends the process."""


def require_renderer(name: str) -> None:
    """Raises `UserError` for a renderer that there is not, or that this machine cannot run.

    EGL is tried once, in a process of its own, which takes a second.
    """
    import_bullet()
    if name not in RENDERERS:
        raise UserError(f"sim.renderer: there is no {name!r}; there are {', '.join(RENDERERS)}")
    if name == "egl":
        _require_egl()


@cache
def _require_egl() -> None:
    way_out = "or use sim.renderer=tiny"
    try:
        ctypes.CDLL(EGL_LIBRARY)
    except OSError as error:
        raise UserError(
            f"sim.renderer: egl needs the system's EGL library ({EGL_LIBRARY}, e.g. the package "
            f"libegl1); install it {way_out}"
        ) from error
    plugin = egl_plugin()
    if plugin is None:
        raise UserError(
            f"sim.renderer: egl needs pybullet's plugin {EGL_PLUGIN}, which this build lacks; "
            f"reinstall pybullet from its wheel {way_out}"
        )
    command = [sys.executable, "-c", _DRAW_ONE_TRIANGLE, plugin]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        raise UserError(
            f"sim.renderer: egl draws nothing on this machine, though {EGL_LIBRARY} is there; "
            f"install an OpenGL driver (Mesa's will do, e.g. the package libgl1-mesa-dri) {way_out}"
        )


def egl_plugin() -> str | None:
    """Path of pybullet's EGL plugin, if this build has one."""
    spec = importlib.util.find_spec(EGL_PLUGIN)
    return None if spec is None else spec.origin


def import_bullet():
    """The pybullet module; its wheels stop at Python 3.11, and training does not need it."""
    try:
        with silent():
            import pybullet
    except ImportError as error:
        raise UserError(
            "pybullet is not installed, and generating data needs it: use Python 3.10 or 3.11 and "
            "`pip install pybullet`, or point paths.dataset at a finished data set"
        ) from error
    if not pybullet.isNumpyEnabled():
        raise UserError("pybullet was built without numpy: reinstall it with numpy present")
    return pybullet


@contextmanager
def silent() -> Iterator[None]:
    """Bullet's C code prints what it found and did; a user wants to read what went wrong."""
    _flush()
    kept = [os.dup(1), os.dup(2)]
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        # What C still holds back would otherwise be printed later, after all.
        _flush()
        for stream, copy in enumerate(kept, start=1):
            os.dup2(copy, stream)
            os.close(copy)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    ctypes.CDLL(None).fflush(None)
