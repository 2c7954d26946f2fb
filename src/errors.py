"""The one exception that users see as a single line, and how it names what they may have meant."""

import difflib
import errno
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType

# What to do where the system does not let a file be read, which says nothing about its bytes.
MORE_FILES = "raise the limit of open files (ulimit -n 4096), or lower data.workers"
READING = {
    errno.EACCES: "ask for the permission to read it",
    errno.EPERM: "ask for the permission to read it",
    errno.EISDIR: "it is a folder; name a file",
    errno.EMFILE: MORE_FILES,
    errno.ENFILE: MORE_FILES,
    errno.ENOMEM: "free some memory and run it again",
}
# What lies in the place of a file that was not fetched, by its first bytes.
STAND_INS = {
    b"version https://git-lfs": "a pointer of Git LFS: git lfs pull",
    b"/annex/objects/": "a pointer of git-annex: git annex get",
    b"<!doctype html": "a web page, perhaps of a failed download: download it again",
    b"<html": "a web page, perhaps of a failed download: download it again",
}
MAY_BE_SOUND = "the file may be sound: look after the disk or the network, and run it again"


class UserError(ValueError):
    """A mistake in what the user gave (a key, a file, a checkpoint), not in the program.

    The message is one line: it names the file or key and says what to do. ``run.py`` prints it
    without a traceback and exits with status 2.
    """


def reason_of(error: Exception) -> str:
    """Returns the first sentence of what another library says, on one line and not too long.

    That of an error which says nothing is its kind.
    """
    return " ".join((str(error) or type(error).__name__).split()).partition(". ")[0][:200]


def way_out_of(error: BaseException, damaged: str, path: Path | None = None) -> str:
    """Returns what to do about a file that cannot be read; ``damaged`` where its bytes are wrong,
    or where there is none. Only then may a message advise to delete anything.

    With the file's ``path`` it is told what lies in its place (`STAND_INS`).
    """
    if is_of_the_system(error):
        return READING.get(error.errno, MAY_BE_SOUND)
    stand_in = stand_in_of(path)
    told = "then run it again" if stand_in in str(error) else f"it is {stand_in}"
    return told if stand_in else damaged


def is_of_the_system(error: BaseException | None) -> bool:
    """Tells whether an error, or one that it comes from, says nothing about the bytes of a file."""
    while error is not None:
        if isinstance(error, OSError) and error.errno not in (None, errno.ENOENT):
            return True
        error = error.__cause__
    return False


def stand_in_of(path: Path | None) -> str:
    """Says what lies in the place of a file, where it is one of `STAND_INS`; else nothing."""
    try:
        with open(path or "", "rb") as file:
            head = file.read(64).lstrip(b"\xef\xbb\xbf \r\n").lower()
    except OSError:
        return ""
    return next((told for start, told in STAND_INS.items() if head.startswith(start)), "")


def closest(name: str, known: Iterable[str]) -> str:
    """Returns ``"; did you mean 'x'?"`` where a known name is near, or ``";"``."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ";"


def import_extra(name: str, extra: str, key: str, instead: str = "") -> ModuleType:
    """Imports a library of an optional extra, where it is used.

    Raises `UserError` that begins with ``key`` where it is missing; ``instead`` is another way out.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise UserError(f"{key}: needs {name}; pip install -e '.[{extra}]'{instead}") from error
