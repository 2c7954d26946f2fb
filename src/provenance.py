"""The origin of a number: digests of code and configuration, commit, machine.

``python -m src.provenance`` prints what stands for the code of data and of trainings. It needs the
standard library alone, and prints the same under every supported Python.
"""

import ast
import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path

SOURCE = Path(__file__).parent
# These parts shape the bytes of a dataset.
DATA_CODE = ("sim", "geometry.py", "voxels.py", "ontology.py", "data/clip.py", "data/rates.py")
# These shape the weights and the scores of a run, beside its data and its configuration.
TRAINING_CODE = (
    *("models", "data", "metrics", "tasks/model.py"),
    *("geometry.py", "ontology.py", "voxels.py"),
)
# The digests of files that were changed and gave the same bytes as before, and of what they were.
# They count as what they were, so that data sets and runs made with those stay finished.
SAME_BYTES = {
    "750240566243": "107af539b21f",  # sim/renderer.py
    "1bc9c89a99dc": "6f5268b2bcfb",  # sim/drawing.py
    "499b433a5f4e": "2dc1e1f8f2f8",  # sim/generate.py
    "caa16c0c30ef": "cfeb4d26a434",  # data/manifest.py
    "90db0f455789": "1c067c03bdb8",  # ontology.py
}


def digest_of(data: object) -> str:
    """Returns twelve hexadecimal digits of the SHA-256 of plain data."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def code_of(parts: Iterable[str]) -> dict[str, str]:
    """Returns a digest of what each Python file of some parts of ``src/`` does, by its path there.

    Comments, docstrings, layout and the messages of errors do not count.
    """
    paths = [SOURCE / part for part in parts]
    files = [file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path])]
    return {
        file.relative_to(SOURCE).as_posix(): _file_digest(file.read_text(encoding="utf-8"))
        for file in sorted(files)
    }


def code_of_modules(names: Iterable[str]) -> dict[str, str]:
    """Returns a digest of what the file of each module does, by the module's dotted name.

    What cannot be found, or is one of the files that shape every dataset, is left out. A package is
    imported to find a module in it; the module itself is not.
    """
    digests = {}
    for name in names:
        try:
            spec = find_spec(name)
        except (ImportError, ValueError):
            continue
        if spec is None or not str(spec.origin).endswith(".py"):
            continue

        file = Path(spec.origin)
        if not any(file.is_relative_to(SOURCE / part) for part in DATA_CODE):
            digests[name] = _file_digest(file.read_text(encoding="utf-8"))
    return digests


def different_file(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Returns the first file of ``src/`` in which two results of `code_of` differ, or nothing."""
    files = sorted(before.keys() | now.keys())
    return next((file for file in files if before.get(file) != now.get(file)), "")


def git_commit() -> str:
    """Returns the commit of the working tree, with ``+`` where it has changes.

    Outside a checkout it is empty.
    """
    command = ["git", "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]
    try:
        return subprocess.check_output(
            command, cwd=SOURCE, stderr=subprocess.DEVNULL, text=True, timeout=10
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def machine() -> str:
    """Returns the processor's name, the cores that this process may use, and Python's version."""
    file, name = Path("/proc/cpuinfo"), platform.processor() or platform.machine()
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        if line.startswith("model name"):
            name = line.split(":", 1)[1].strip()
    return f"{name}, {len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}"


@cache
def _file_digest(source: str) -> str:
    digest = digest_of(_meaning(ast.parse(source)))
    return SAME_BYTES.get(digest, digest)


def _meaning(node: object) -> object:
    """Turns a syntax tree into plain data; `ast.unparse` would differ between Pythons."""
    match node:
        case ast.Expr(value=ast.Constant(value=str())):  # a docstring
            return None
        case ast.Raise(exc=ast.Call(func=kind)):  # without its message
            return ["Raise", _meaning(kind)]
        case list():
            return [meaning for each in node if (meaning := _meaning(each)) is not None]
        case ast.AST():
            # Newer versions have more fields, which are empty where the source is the same.
            fields = [each for each in ast.iter_fields(node) if each[1] not in (None, [])]
            return [type(node).__name__, *([name, _meaning(value)] for name, value in fields)]
    return [type(node).__name__, node if isinstance(node, str) else repr(node)]


if __name__ == "__main__":
    for name, parts in (("data", DATA_CODE), ("training", TRAINING_CODE)):
        print(name, digest_of(code_of(parts)))
