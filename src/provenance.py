"""Where a number comes from: hashes of code and configuration, commit, packages, machine."""

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
PACKAGES = ("torch", "lightning", "torchmetrics", "numpy", "numba", "pybullet", "embreex", "pillow")


def digest_of(data: object) -> str:
    """Twelve hexadecimal digits of the SHA-256 of plain data."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def code_digest(paths: Iterable[Path]) -> str:
    """Digest of what the Python files do: comments, docstrings and layout do not count."""
    files = sorted(
        file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path])
    )
    return digest_of(
        [
            [str(file.relative_to(SOURCE)), _statements(file.read_text(encoding="utf-8"))]
            for file in files
        ]
    )


def source_digest() -> str:
    """Digest of all of ``src/``, as it lies on the disk now."""
    return code_digest([SOURCE])


def code_version(config: Mapping) -> str:
    """The version of a result: digest of ``src/`` and of the composed configuration."""
    return digest_of([source_digest(), config])


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
def _statements(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_text(body[0]):
            node.body = body[1:] or [ast.Pass()]
    return ast.unparse(tree)


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
