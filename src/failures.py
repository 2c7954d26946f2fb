"""Which failures are the user's to mend, and the one line that says how."""

import errno

import hydra.errors
from omegaconf.errors import OmegaConfBaseException

from .errors import UserError

DISK = {
    errno.ENOSPC: "the disk is full; free some space and run it again",
    errno.EDQUOT: "the disk quota is used up; free some space and run it again",
    errno.EROFS: "the disk is read-only; set paths.data and paths.runs to a writable folder",
    errno.EACCES: "no permission; set paths.data and paths.runs to a writable folder",
}


def one_line(error: BaseException) -> str | None:
    """The message for a user's mistake, or ``None`` where the program itself is at fault."""
    for cause in _chain(error):
        if isinstance(cause, UserError):
            return str(cause)
        if isinstance(cause, OSError) and cause.errno in DISK:
            return f"{cause.filename or 'writing'}: {DISK[cause.errno]}"
    for cause in _chain(error):
        if isinstance(cause, hydra.errors.HydraException | OmegaConfBaseException):
            return _squeezed(str(cause))
    return None


def _chain(error: BaseException):
    """The error and what led to it, innermost last."""
    seen = []
    while error is not None and error not in seen:
        seen.append(error)
        error = error.__cause__ or error.__context__
    return seen


def _squeezed(text: str) -> str:
    return " ".join(text.split())
