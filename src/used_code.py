"""The code that a configuration uses, which decides whether a run or a dataset is finished.

It is the import closure of the functions and classes that the configuration names. It is read from
syntax trees with the standard library alone, so nothing is imported, and it is the same under every
supported Python. ``python -m src.used_code`` prints the digest of every file of ``src/``.
"""

import ast
import csv
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from .provenance import digest_of

SOURCE = Path(__file__).parent
# `python -m studies.speed.sameness RUN RUN` has compared what each line says is the same.
SAME_BITS = "same_bits.csv"
# Files that change no byte, weight or score: errors, checks of settings, writing, processes, names.
NEUTRAL = {
    *("atomic.py", "dotted.py", "errors.py", "jit.py", "limits.py", "locks.py", "provenance.py"),
    *("run_folder.py", "terminal.py", "used_code.py", "worker_pool.py"),
    *("data/files.py", "data/manifest.py", "data/shards.py", "tasks/scoring.py"),
}
# Packages whose versions are recorded, and whose code is not part of an identity.
LIBRARIES = {*sys.stdlib_module_names, "torch", "lightning", "torchmetrics", "transformers"}


def targets_of(config: object) -> Iterator[str]:
    """Yields the dotted name of every ``_target_`` in a nested configuration of plain data."""
    if isinstance(config, Mapping):
        if "_target_" in config:
            yield str(config["_target_"])
        config = list(config.values())
    if isinstance(config, list | tuple):
        for value in config:
            yield from targets_of(value)


def code_of(names: Iterable[str]) -> dict[str, str]:
    """Returns a digest of what each file does that the modules, classes or functions need.

    ``names`` are dotted. The keys are paths in ``src/``. A module elsewhere counts by its own file
    and what it imports of ``src/``, and its key is its dotted name. Comments, docstrings, layout
    and the messages of errors do not count, and neither do libraries and names not found.
    """
    digests: dict[str, str] = {}
    to_read = list(names)
    while to_read:
        module = _module_of(to_read.pop())
        if module and module.key not in digests.keys() | NEUTRAL:
            text = module.file.read_text(encoding="utf-8")
            digest = file_digest(text)
            digests[module.key] = _same_as().get((module.key, digest), digest)
            to_read += [name for name in _imported(text, module.package) if _is_own(name)]

    # A file that does nothing of its own for an identity has no digest there.
    return {key: digest for key, digest in sorted(digests.items()) if digest}


@cache
def _same_as() -> dict[tuple[str, str], str]:
    """Returns, for the digest of a file that makes the same data and trains to the same bits as an
    older one did, the older digest, so that what is finished stays finished."""
    with (Path(__file__).parent / SAME_BITS).open(encoding="utf-8", newline="") as file:
        return {(row["file"], row["digest"]): row["as"] for row in csv.DictReader(file)}


def different_file(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Returns the first file of two results of `code_of` that is in both and differs, or nothing.

    Files in only one of them are of classes that only one configuration names.
    """
    differing = (key for key in sorted(before.keys() & now.keys()) if before[key] != now[key])
    return next((f"src/{key}" if key.endswith(".py") else key for key in differing), "")


@cache
def file_digest(source: str) -> str:
    """Returns a digest of Python code without comments, docstrings, layout and error messages."""
    return digest_of(_meaning(_tree(source)))


class _Module(NamedTuple):
    """A file, its key in `code_of`, and the dotted package that its relative imports start from."""

    key: str
    file: Path
    package: str


def _is_own(name: str) -> bool:
    return name.partition(".")[0] == __package__


def _module_of(name: str) -> _Module | None:
    """Returns the module that defines a dotted name, through the re-exports of packages; ``None``
    for a library and for an unknown name."""
    top, *parts = name.split(".")
    if top in LIBRARIES or not (place := _place_of(top)):
        return None

    package = top
    while place.is_dir():
        part = parts.pop(0) if parts else ""
        if part and (place / part).is_dir():
            place, package = place / part, f"{package}.{part}"
        elif part and (place / f"{part}.py").is_file():
            place = place / f"{part}.py"
        else:
            place = place / "__init__.py"
            if not place.is_file():
                return None
            # The file of a re-exported class counts, and not that of its package.
            text = place.read_text(encoding="utf-8")
            for source in _imported(text, package):
                if part and source.endswith(f".{part}"):
                    return _module_of(source)

    if _is_own(name):
        return _Module(place.relative_to(SOURCE).as_posix(), place, package)
    is_whole = place.stem in ("__init__", package)
    return _Module(package if is_whole else f"{package}.{place.stem}", place, package)


def _place_of(top: str) -> Path | None:
    """Returns the folder, or the file, of a package or module at the top level."""
    if top == __package__:
        return SOURCE
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    return Path(spec.origin) if spec and str(spec.origin).endswith(".py") else None


@cache
def _imported(text: str, package: str) -> tuple[str, ...]:
    """Returns the dotted name of all that a file of ``package`` imports, absolute."""
    names = []
    for node in ast.walk(_tree(text)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            names += [f"{base}.{alias.name}" for alias in node.names]
    return tuple(names)


@cache
def _tree(source: str) -> ast.Module:
    return ast.parse(source)


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
    for path in sorted(SOURCE.rglob("*.py")):
        print(file_digest(path.read_text(encoding="utf-8")), path.relative_to(SOURCE).as_posix())
