"""The two renderers, and whether this machine can run them."""

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

# TinyRenderer runs anywhere, on one core; EGL is faster on large images and needs the system's
# OpenGL. They give different pixels, so a dataset has one of them for all its clips.
RENDERERS: Final = ("tiny", "egl")

EGL_LIBRARY: Final = "libEGL.so.1"
EGL_PLUGIN: Final = "eglRenderer"

# It runs in a process of its own, because a failed load ends the process.
_DRAW_ONE_TRIANGLE = """
import sys, pathlib, tempfile, numpy, pybullet as bullet
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
depth = bullet.getCameraImage(8, 8, view, frustum, renderer=flag)[3]
assert numpy.reshape(depth, (8, 8))[4, 4] < 1
"""


def require_renderer(name: str) -> None:
    """Raises `UserError` for a renderer that does not exist, or that this machine cannot run.

    EGL is tried once, in a process of its own, which takes a second.
    """
    import_bullet()
    require_known(name)
    if name == "egl" and (fault := _egl_fault()):
        raise UserError(f"sim.renderer: egl {fault} or use sim.renderer=tiny")


def require_known(name: str) -> None:
    """Raises `UserError` for a renderer that does not exist."""
    if name not in RENDERERS:
        raise UserError(f"sim.renderer: there is no {name!r}; there are {', '.join(RENDERERS)}")


@cache
def _egl_fault() -> str | None:
    """Returns why EGL does not draw on this machine and how to change that; None where it does."""
    try:
        ctypes.CDLL(EGL_LIBRARY)
    except OSError:
        package = f"{EGL_LIBRARY}, e.g. the package libegl1"
        return f"needs the system's EGL library ({package}); install it"

    plugin = egl_plugin()
    if plugin is None:
        fault = f"needs pybullet's plugin {EGL_PLUGIN}, which this build lacks"
        return f"{fault}; reinstall pybullet from its wheel"

    command = [sys.executable, "-c", _DRAW_ONE_TRIANGLE, plugin]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        way_out = "install an OpenGL driver (Mesa's will do, e.g. the package libgl1-mesa-dri)"
        return f"draws nothing on this machine, though {EGL_LIBRARY} is there; {way_out}"
    return None


def egl_plugin() -> str | None:
    """Returns the path of pybullet's EGL plugin, if this build has one."""
    spec = importlib.util.find_spec(EGL_PLUGIN)
    return None if spec is None else spec.origin


def import_bullet():
    """Imports and returns pybullet, which only the generation of data needs.

    Its own wheels stop at Python 3.11; later Pythons get the same engine, under the same name, from
    the package ``pybullet-arm64``. Raises `UserError` where there is none.
    """
    try:
        with silent():
            import pybullet
    except ImportError as error:
        raise UserError(
            "pybullet is not installed, and generating data needs it: give make setup, or point "
            "paths.dataset at a finished dataset"
        ) from error
    return pybullet


@contextmanager
def silent() -> Iterator[None]:
    """Hides all that is printed meanwhile, also by C code.

    Bullet prints its findings and doings; a user wants to read what went wrong.
    """
    _flush()
    kept = [os.dup(1), os.dup(2)]
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        yield

    finally:
        # The output that C still holds back would otherwise be printed later, after all.
        _flush()
        for stream, copy in enumerate(kept, start=1):
            os.dup2(copy, stream)
            os.close(copy)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    ctypes.CDLL(None).fflush(None)
