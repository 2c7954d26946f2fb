"""Reading and writing a clip's files, with errors that name the file."""

import fnmatch
import hashlib
import os
import resource
import zipfile
import zlib
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UserError, stand_in_of, way_out_of

# What numpy, pandas, PIL, json and zipfile raise over a file that is not what was written.
BROKEN = (OSError, ValueError, TypeError, KeyError, RuntimeError, EOFError)
BROKEN += (zipfile.BadZipFile, zlib.error)


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Turns whatever an unreadable file of a clip raises into one line that names it."""
    try:
        yield path
    except BROKEN as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        again = f"delete the folder {path.parent} and run task=generate to make that clip again"
        reason, way_out = reason or type(error).__name__, way_out_of(error, again, path)
        raise UserError(f"{path}: cannot be read ({reason}); {way_out}") from error


def open_npz(path: Path) -> np.lib.npyio.NpzFile:
    """Opens an archive that others may have written. Raises `ValueError` that says what is there
    instead, and `OSError`."""
    with open(path, "rb") as file:
        head = file.read(24)
    if stand_in := stand_in_of(path):
        raise ValueError(f"it is {stand_in}")
    if head.startswith(b"\x93NUMPY"):
        raise ValueError("it is a single array of numpy.save; write it with numpy.savez")
    if not head.startswith(b"PK"):
        raise ValueError("it is no npz archive; write it with numpy.savez")
    return np.load(path, allow_pickle=False)


def array_of(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    """Returns an array of an archive. Raises `ValueError` that says what it has instead."""
    if name not in archive.files:
        raise ValueError(f"it has no {name}, but {', '.join(archive.files[:3]) or 'nothing'}")
    return archive[name]


def fault_of(labels: np.ndarray) -> str:
    """Says why an array holds no class ids, as NaN would become class 0; empty where it does."""
    whole = labels.dtype.kind in "iu"
    if labels.dtype.kind == "f":
        whole = bool((labels == np.floor(labels)).all())
    return "" if whole else f"has {labels.dtype} that are no whole numbers, and so no class ids"


def files_below(root: Path, name: str) -> list[Path]:
    """Returns the files of that name, or with a * in it of such names, below a folder, also through
    links, sorted."""
    found = os.walk(root, followlinks=True)
    return sorted(
        Path(folder, each) for folder, _, files in found for each in fnmatch.filter(files, name)
    )


class OpenArchives:
    """Archives that this process has opened, the latest used ones; not more than half of the files
    that it may have open. A fork begins with none: it would move a file position that it shares."""

    def __init__(self) -> None:
        self._opened_by, self._archives = -1, {}

    def get(self, key: Hashable, open_archive: Callable[[], Any]) -> Any:
        """Returns the archive of that key, which ``open_archive`` opens where it is not open."""
        if self._opened_by != os.getpid():
            self._opened_by, self._archives = os.getpid(), {}

        archive = self._archives.pop(key, None)
        if archive is None:
            soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
            # What is let go closes itself, once no other thread reads it.
            while self._archives and 2 * len(self._archives) >= soft != resource.RLIM_INFINITY:
                self._archives.pop(next(iter(self._archives)), None)
            archive = open_archive()
        self._archives[key] = archive  # now the last one
        return archive


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Puts the file's name into an `OSError`, which may know the disk's reason only."""
    try:
        yield path
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def flush_to_disk(path: Path) -> None:
    """Waits for the disk: the file's name could outlast a power cut that its contents do not."""
    with writing(path):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def sha256_of(path: Path) -> str:
    """Returns the SHA-256 of a file, in hexadecimal digits."""
    with open(path, "rb") as file:
        digest = hashlib.sha256()
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def differing_files(folder: Path, sums: Mapping[str, str]) -> list[str]:
    """Names of a folder's files that are missing or whose SHA-256 is not the one given."""
    return [
        name
        for name, digest in sums.items()
        if not (folder / name).is_file() or sha256_of(folder / name) != digest
    ]
