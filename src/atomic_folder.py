"""Writing a folder of results whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .atomic import unwritable


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """A new folder to fill, which takes the place of ``path`` when the block succeeds.

    After any failure the old one stands. Raises `UserError` where it cannot be written.

    A process that is killed between the two renames leaves the old folder as ``.<name>.old``.
    """
    path = Path(path)
    temporary, old = (path.with_name(f".{path.name}.{kind}") for kind in ("new", "old"))
    try:
        for left_over in (temporary, old):
            shutil.rmtree(left_over, ignore_errors=True)
        temporary.mkdir(parents=True)
        yield temporary
        if path.exists():
            os.rename(path, old)
        os.rename(temporary, path)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
