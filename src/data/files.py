"""Reading and writing a clip's files, with errors that name the file."""

import hashlib
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ..errors import UserError

# What numpy, pandas, PIL, json and zipfile raise over a file that is not what was written.
BROKEN = (OSError, ValueError, TypeError, KeyError, RuntimeError, EOFError)
BROKEN += (zipfile.BadZipFile, zlib.error)


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Turns whatever a broken file of a clip raises into one line that names it."""
    try:
        yield path
    except BROKEN as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"{path}: cannot be read ({reason}); delete the folder {path.parent} and run "
            "task=generate to make that clip again"
        ) from error


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
