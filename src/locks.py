"""Locks between processes: the system frees those of a process that dies.

They are those of flock. The package filelock has no lock that could take their place: its own are
exclusive only, and its read-write lock, which is one of SQLite, takes "no locks available" for
"busy". On a file system without locks it would wait for days instead of saying so.
"""

import errno
import fcntl
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import UserError
from .terminal import say

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


def telling(reason: str) -> Callable[[], None]:
    """Returns an ``on_wait`` that says in one line what is waited for."""

    return lambda: say(f"{reason}; waiting for it")


@contextmanager
def locked(path: Path, on_wait: Callable[[], None], shared: bool = False) -> Iterator[None]:
    """Holds the lock of a file, for itself or ``shared`` with others that share it.

    Calls ``on_wait`` once if it must wait for its turn. Raises `UserError` on a file system that
    has no locks.
    """
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    with open(path, "w") as file:
        if not _take(file.fileno(), kind | fcntl.LOCK_NB, path):
            on_wait()
            _take(file.fileno(), kind, path)
        yield


@contextmanager
def locked_if_free(path: Path) -> Iterator[bool]:
    """Holds the lock of a file for itself and yields true, or yields false where others hold it."""
    with open(path, "w") as file:
        yield _take(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB, path)


def _take(descriptor: int, kind: int, path: Path) -> bool:
    try:
        fcntl.flock(descriptor, kind)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        raise UserError(
            f"{path}: this file system has no file locks; set paths.data to a folder on one that "
            "has, and move the finished dataset"
        ) from error
    return True
