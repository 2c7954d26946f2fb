"""Writing a folder of results whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from .atomic import unwritable
from .locks import alone_at


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """A new folder to fill, which takes the place of ``path`` when the block succeeds.

    After any failure the old one stands. A second process that writes the same folder waits for its
    turn. Raises `UserError` where it cannot be written.

    A process that is killed between the two renames leaves the old folder as ``.<name>.old``; the
    next one puts it back before it begins.
    """
    path = Path(path)
    temporary, old = (path.with_name(f".{path.name}.{kind}") for kind in ("new", "old"))
    with ExitStack() as held:
        try:
            held.enter_context(alone_at(path, f"{path}: another process is writing it"))
            _put_back(old, path)
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
            with suppress(OSError):
                _put_back(old, path)
            shutil.rmtree(temporary, ignore_errors=True)


def _put_back(old: Path, path: Path) -> None:
    if old.exists() and not path.exists():
        os.rename(old, path)
