"""Writing a result file whole or not at all."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import UserError


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
        raise unwritable(path, error) from error
    finally:
        # A read-only or vanished folder holds no temporary file, and must not hide the error.
        if temporary.exists():
            temporary.unlink()


def unwritable(path: Path, error: OSError) -> UserError:
    """Returns the error to raise where a file or a folder cannot be written."""
    way_out = "choose another folder"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        way_out = f"free some space or {way_out}"
    return UserError(f"{path}: cannot be written ({error.strerror or error}); {way_out}")
