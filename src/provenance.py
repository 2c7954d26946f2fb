"""Where a number comes from: digests of code and configuration, commit, packages, machine.

``python -m src.provenance`` prints the digests of what shapes the data and of what shapes trained
weights and their scores. It needs the standard library alone, and prints the same under every
supported Python.
"""

import ast
import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parent
DATA_CODE = ("sim", "geometry.py", "ontology.py", "data/clip.py", "data/rates.py")
"""What shapes the bytes of a data set."""
TRAINING_CODE = (
    *("models", "data", "metrics", "tasks/model.py"),
    *("geometry.py", "ontology.py", "rays.py", "voxel_march.py"),
)
"""What shapes the weights and the scores of a run, beside its data and its configuration."""
PACKAGES = ("torch", "lightning", "torchmetrics", "numpy", "numba", "pybullet", "embreex", "pillow")


def digest_of(data: object) -> str:
    """Twelve hexadecimal digits of the SHA-256 of plain data."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def code_of(parts: Iterable[str]) -> dict[str, str]:
    """Digest of what each Python file of some parts of ``src/`` does, by its path in there.

    Comments, docstrings, layout and the messages of errors do not count.
    """
    paths = [SOURCE / part for part in parts]
    files = [file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path])]
    return {
        file.relative_to(SOURCE).as_posix(): _file_digest(file.read_text(encoding="utf-8"))
        for file in sorted(files)
    }


def different_file(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """The first file of ``src/`` in which two results of `code_of` differ, or nothing."""
    files = sorted(before.keys() | now.keys())
    return next((file for file in files if before.get(file) != now.get(file)), "")


def git_commit() -> str:
    """The commit of the working tree, with ``+`` where it has changes; empty outside a checkout."""
    try:
        commit = _git("rev-parse", "--short=12", "HEAD")
        return commit + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return ""


def package_versions() -> dict[str, str]:
    """Versions of the packages that shape data and results; absent ones are left out."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def machine() -> str:
    """What ran it: the processor's name, the cores that this process may use, Python's version."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        name = names[0] if names else name
    except OSError:
        pass
    return f"{name}, {len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}"


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=SOURCE, check=True, capture_output=True, text=True, timeout=10
    )
    return done.stdout.strip()


@cache
def _file_digest(source: str) -> str:
    return digest_of(_meaning(ast.parse(source)))


def _meaning(node: object) -> object:
    """A syntax tree as plain data. `ast.unparse` would write it otherwise in each Python."""
    if isinstance(node, list):
        texts = [isinstance(each, ast.Expr) and _is_text(each.value) for each in node]
        return [_meaning(each) for each, is_text in zip(node, texts) if not is_text]
    if not isinstance(node, ast.AST):
        return [type(node).__name__, node if isinstance(node, str) else repr(node)]
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
        return ["Raise", _meaning(node.exc.func)]

    # Newer versions have more fields, which are empty where the source is the same.
    fields = [(name, value) for name, value in ast.iter_fields(node) if value not in (None, [])]
    return [type(node).__name__, *([name, _meaning(value)] for name, value in fields)]


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


if __name__ == "__main__":
    for name, parts in (("data", DATA_CODE), ("training", TRAINING_CODE)):
        print(name, digest_of(code_of(parts)))
