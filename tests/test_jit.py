"""Compiled functions: kept on the disk, apart by what they all say."""

import re

from src.jit import kernels_digest
from src.used_code import SOURCE


def test_compiled_functions_are_kept_apart_by_what_they_call(tmp_path):
    kernel = tmp_path / "kernel.py"
    kernel.write_text("from .jit import njit\nX = 1\n")
    (tmp_path / "other.py").write_text("X = 1\n")
    before = kernels_digest(tmp_path)
    (tmp_path / "other.py").write_text("X = 2\n")
    assert kernels_digest(tmp_path) == before
    kernel.write_text("from .jit import njit\nX = 2\n")
    assert kernels_digest(tmp_path) != before


def test_every_compiled_function_is_among_them():
    by_numba = re.compile(r"^\s*(import|from) numba", re.MULTILINE)
    using = [path.name for path in SOURCE.rglob("*.py") if by_numba.search(path.read_text())]
    assert using == ["jit.py"]
