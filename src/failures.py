"""Which failures are the user's to mend, and the one line that says how."""

import difflib
import errno
import logging
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from hydra.errors import ConfigCompositionException, HydraException, MissingConfigException
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from .errors import UserError

ELSEWHERE = "set paths.data and paths.runs to folders that can be written to"
DISK = {
    errno.ENOSPC: "the disk is full; free some space and run it again",
    errno.EDQUOT: "the disk quota is used up; free some space and run it again",
    errno.EROFS: f"the disk is read-only; {ELSEWHERE}",
    errno.EACCES: f"no permission; {ELSEWHERE}",
    errno.EPERM: f"no permission; {ELSEWHERE}",
    errno.ENOTDIR: f"not a folder; {ELSEWHERE}",
    errno.EEXIST: f"a file is in the way; move it, or {ELSEWHERE}",
}


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Ends the program with one line on a user's mistake; a bug keeps its traceback.

    The line goes to standard error. The exit status is 2, or 130 after Ctrl-C.
    """
    try:
        yield
    except KeyboardInterrupt:
        _leave("interrupted; the same command goes on from what is finished", status=130)
    except Exception as error:
        message = one_line(error)
        if message is None:
            raise
        _leave(message, status=2)


def _leave(message: str, status: int) -> None:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(status)


def one_line(error: BaseException) -> str | None:
    """The message for a user's mistake, or ``None`` where the program itself is at fault."""
    chain = _chain(error)
    for cause in chain:
        if isinstance(cause, UserError):
            # From a loader's worker the message arrives as that process's whole traceback.
            return str(cause).strip().splitlines()[-1].removeprefix("src.errors.UserError: ")
        if isinstance(cause, OSError) and cause.errno in DISK:
            return f"{cause.filename or 'writing'}: {DISK[cause.errno]}"
    composing = any(isinstance(cause, ConfigCompositionException) for cause in chain)
    for cause in reversed(chain):
        if isinstance(cause, MissingConfigException) and cause.missing_cfg_file:
            return _no_such_option(cause)
        if isinstance(cause, ConfigAttributeError | ConfigKeyError) and composing:
            return _no_such_key(cause)
    for cause in chain:
        if isinstance(cause, ConfigAttributeError):
            return None  # the program asks for a key that no configuration has
        if isinstance(cause, HydraException | OmegaConfBaseException):
            return " ".join(str(cause).split())
    return None


def quiet_libraries() -> None:
    """Leaves the output to the program's own words: only warnings of others, and not of these."""
    logging.disable(logging.INFO)  # Lightning sets its loggers' levels when it is imported
    warnings.filterwarnings("ignore", module=r"(lightning|torchmetrics|torch)\.")


def closest(word: str, known: Iterable[str]) -> str:
    """``"; did you mean 'x'?"`` where a known word is near, or nothing."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ";"


def _no_such_option(error: MissingConfigException) -> str:
    group, _, name = error.missing_cfg_file.rpartition("/")
    options = error.options or []
    return f"{group}: there is no {name!r}{closest(name, options)} there are {', '.join(options)}"


def _no_such_key(error: ConfigAttributeError | ConfigKeyError) -> str:
    name = str(error.full_key).rpartition(".")[2]
    siblings = list(error.parent_node) if isinstance(error.parent_node, DictConfig) else []
    return (
        f"{error.full_key}: no such key{closest(name, map(str, siblings))} "
        f"there are {', '.join(map(str, siblings))}"
    )


def _chain(error: BaseException) -> list[BaseException]:
    """The error and all that led to it."""
    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or error.__context__
    return chain
