"""Which failures are the user's to mend, and the one line that says how."""

import errno
import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from .errors import UserError

DISK = {
    errno.ENOSPC: "the disk is full; free some space and run it again",
    errno.EDQUOT: "the disk quota is used up; free some space and run it again",
    errno.EROFS: "the disk is read-only; set paths.data and paths.runs to a writable folder",
    errno.EACCES: "no permission; set paths.data and paths.runs to a writable folder",
}
CHATTY = ("lightning", "lightning.pytorch", "lightning.fabric")


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Ends the program with one line and status 1 on a user's mistake; a bug keeps its traceback."""
    try:
        yield
    except Exception as error:
        message = one_line(error)
        if message is None:
            raise
        sys.exit(f"error: {message}")


def one_line(error: BaseException) -> str | None:
    """The message for a user's mistake, or ``None`` where the program itself is at fault."""
    for cause in _chain(error):
        if isinstance(cause, UserError):
            # From a loader's worker the message arrives as that process's whole traceback.
            return str(cause).strip().splitlines()[-1].removeprefix("src.errors.UserError: ")
        if isinstance(cause, OSError) and cause.errno in DISK:
            return f"{cause.filename or 'writing'}: {DISK[cause.errno]}"
    for cause in _chain(error):
        if isinstance(cause, HydraException | OmegaConfBaseException):
            return " ".join(str(cause).split())
    return None


def quiet_libraries() -> None:
    """Leaves standard output to the program's own words."""
    for name in CHATTY:
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module=r"(lightning|torchmetrics|torch)\.")


def _chain(error: BaseException) -> list[BaseException]:
    """The error and all that led to it."""
    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or error.__context__
    return chain
