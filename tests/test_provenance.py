"""Where a number comes from: what changes an identity, what does not, and under which Python."""

import ast
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from src import provenance
from src.jit import kernels_digest
from src.provenance import (
    DATA_CODE,
    SOURCE,
    TRAINING_CODE,
    code_of,
    different_file,
    digest_of,
    git_commit,
)

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
# What the files that shape data or weights use besides, and what shapes neither: errors, writing,
# processes, names, and what configures the scores.
NEUTRAL = {
    *("atomic", "bounds", "errors", "jit", "locks", "provenance", "run_folder", "terminal"),
    *("worker_pool", "data/shards", "data/manifest", "data/files", "tasks/scoring"),
}


def test_equal_data_have_equal_digests_whatever_their_order():
    assert digest_of({"a": 1, "b": [2, 3]}) == digest_of({"b": [2, 3], "a": 1})
    assert digest_of({"a": 1}) != digest_of({"a": 2})
    assert len(digest_of({})) == 12


# ----------------------------------------------------------------------------------- of a file


@pytest.fixture
def digest_after(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "SOURCE", tmp_path)

    def digest(text, name="part.py"):
        for old in tmp_path.glob("*.py"):
            old.unlink()
        (tmp_path / name).write_text(text)
        return code_of([name])

    return digest


CODE = '''WORDS = "a", "1", None


def f(x):
    """Doubles."""
    if x < 0:
        raise ValueError("negative")
    return 2 * x
'''


@pytest.mark.parametrize(
    ("edit", "counts"),
    [
        (("Doubles", "Gives twice x"), False),
        (('    """Doubles."""\n', "    # why\n"), False),
        (("2 * x", "(\n        2\n        * x\n    )"), False),
        (("negative", "below zero"), False),
        (("2 *", "3 *"), True),
        (("2 *", "2.0 *"), True),
        (("def f(x)", "def f(x, y=0)"), True),
        (("def f(x)", "X = 1\ndef f(x)"), True),
        (("ValueError", "TypeError"), True),
        (('"a"', '"b"'), True),
        (('"1"', "1"), True),
        (("None", "0"), True),
    ],
    ids=str,
)
def test_statements_count_and_prose_and_layout_do_not(digest_after, edit, counts):
    text = CODE.replace(*edit)
    assert text != CODE
    assert (digest_after(text) != digest_after(CODE)) == counts


def test_a_file_s_place_counts(digest_after):
    assert digest_after(CODE, "other.py") != digest_after(CODE)


def test_the_first_file_that_differs_is_named():
    before = {"a.py": "1", "b.py": "2"}
    assert different_file(before, dict(before)) == ""
    assert different_file(before, {"a.py": "1", "b.py": "3", "c.py": "4"}) == "b.py"
    assert different_file(before, {"b.py": "2"}) == "a.py"


# --------------------------------------------------------------------------------- of the project


# An edit of a file of ``src/``, and whether it changes the data and the training.
EDITS = (
    ("tasks/report.py", '"""task=report', 'X = 1\n"""task=report', False, False),
    ("models/losses.py", "max_ratio: float = 4.0", "max_ratio: float = 4.5", False, True),
    ("sim/traffic.py", "\nimport numpy", "\nX = 1\nimport numpy", True, False),
    ("geometry.py", "MIN_DEPTH_M = 0.1", "MIN_DEPTH_M = 0.2", True, True),
)


def test_an_edit_changes_what_it_shapes_and_nothing_else(tmp_path, monkeypatch):
    before = [code_of(parts) for parts in (DATA_CODE, TRAINING_CODE)]
    shutil.copytree(SOURCE, tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "SOURCE", tmp_path / "src")
    for file, old, new, *changes in EDITS:
        text = (tmp_path / "src" / file).read_text()
        assert old in text
        (tmp_path / "src" / file).write_text(text.replace(old, new, 1))
        after = [code_of(parts) for parts in (DATA_CODE, TRAINING_CODE)]
        assert [one != other for one, other in zip(before, after)] == changes, file
        (tmp_path / "src" / file).write_text(text)


def test_a_file_that_is_known_to_give_the_same_bytes_counts_as_what_it_was(
    digest_after, monkeypatch
):
    before, after = digest_after(CODE), digest_after(CODE.replace("2 *", "x +"))
    assert before != after
    monkeypatch.setattr(provenance, "SAME_BYTES", {after["part.py"]: before["part.py"]})
    provenance._file_digest.cache_clear()
    assert digest_after(CODE.replace("2 *", "x +")) == before
    provenance._file_digest.cache_clear()


def test_every_file_that_counts_as_what_it_was_is_there():
    """An entry for a text that no file has any more says nothing and may go."""
    now = code_of([*DATA_CODE, *TRAINING_CODE])
    assert set(provenance.SAME_BYTES.values()) <= set(now.values())


@pytest.mark.parametrize("parts", [DATA_CODE, TRAINING_CODE], ids=["data", "training"])
def test_nothing_that_shapes_it_is_left_out(parts):
    """What the listed files import is listed too, or shapes nothing."""
    listed = {file.removesuffix(".py") for file in code_of(parts)}
    listed |= {module.removesuffix("/__init__") for module in listed}
    for file in code_of(parts):
        for module in imported(SOURCE / file):
            assert module in listed | NEUTRAL, f"{file} imports src/{module}.py, which shapes it"


def imported(path):
    """The modules of ``src/`` that a file imports, as paths in there."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            package = path.relative_to(SOURCE).parts[: -node.level]
            module = "/".join([*package, *(node.module or "").split(".")]).strip("/")
            if node.module:
                yield module
            else:
                yield from ("/".join([*package, alias.name]) for alias in node.names)


def test_it_is_the_same_under_every_python():
    """As printed with the standard library alone, by each interpreter that this machine has."""
    printed = {}
    for version in PYTHONS:
        for name in interpreters(version):
            done = subprocess.run(
                [name, "-S", "-m", "src.provenance"],
                cwd=SOURCE.parent,
                capture_output=True,
                text=True,
            )
            if done.returncode == 0:
                printed[version] = done.stdout
                break

    assert f"{sys.version_info[0]}.{sys.version_info[1]}" in printed
    assert len(set(printed.values())) == 1, printed
    data, training = (digest_of(code_of(parts)) for parts in (DATA_CODE, TRAINING_CODE))
    assert printed.popitem()[1] == f"data {data}\ntraining {training}\n"


def interpreters(version):
    """Where a Python of that version may be: this one, on the path, or of pyenv."""
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        yield sys.executable
    for path in (*os.get_exec_path(), *Path.home().glob(f".pyenv/versions/{version}.*/bin")):
        if (name := Path(path) / f"python{version}").is_file():
            yield str(name)


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


# ------------------------------------------------------------------------------ commit and machine


def test_the_commit_says_whether_files_were_changed(tmp_path, monkeypatch):
    def git(*words):
        name = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *name, *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    monkeypatch.setattr(provenance, "SOURCE", tmp_path)
    assert git_commit() == "", "outside a checkout"
    git("init")
    (tmp_path / "a.py").write_text("A = 1\n")
    git("add", "a.py")
    git("commit", "--no-verify", "-m", "one")
    clean = git_commit()
    assert len(clean) == 12
    (tmp_path / "a.py").write_text("A = 2\n")
    assert git_commit() == clean + "+"


def test_the_machine_is_told_with_its_cores_and_python():
    name, cores, python = provenance.machine().rsplit(", ", 2)
    assert name
    assert cores == f"{len(os.sched_getaffinity(0))} cores"
    assert python == f"Python {platform.python_version()}"
