"""Writing a result file, or a folder of results, whole or not at all."""

import errno
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import UserError

A_DAY_S = 86_400


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path beside ``path``, which takes its place when the block succeeds.

    Makes missing folders. After any failure the old file stands and no temporary one is left.
    Raises `UserError` where the disk is read-only or full.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        # A read-only or vanished folder holds no temporary file, and must not hide the error.
        if temporary.exists():
            temporary.unlink()


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """Yields a new folder to fill, which takes the place of ``path`` when the block succeeds.

    After any failure the old one stands. Two processes that write the same folder at once fill one
    each, and the later one stays. Raises `UserError` where it cannot be written.

    A process that is killed between the two renames leaves the old folder as ``.<name>.old``; the
    next one puts it back before it begins, and removes what was left half filled a day ago.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.new")
    old = path.with_name(f".{path.name}.old")

    try:
        _put_back(old, path)
        # A younger one may be another process's work.
        for left_over in path.parent.glob(f".{path.name}.*.new"):
            if time.time() - left_over.stat().st_mtime > A_DAY_S:
                shutil.rmtree(left_over, ignore_errors=True)
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        yield temporary

        # No name can be given to two folders, so the old one must go first.
        shutil.rmtree(old, ignore_errors=True)
        if path.exists():
            os.rename(path, old)
        os.rename(temporary, path)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            _put_back(old, path)
        shutil.rmtree(temporary, ignore_errors=True)


def _put_back(old: Path, path: Path) -> None:
    if old.exists() and not path.exists():
        os.rename(old, path)


def _unwritable(path: Path, error: OSError) -> UserError:
    """Returns the error to raise where a file or a folder cannot be written."""
    way_out = "choose another folder"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        way_out = f"free some space or {way_out}"
    return UserError(f"{path}: cannot be written ({error.strerror or error}); {way_out}")
