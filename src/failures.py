"""Which failures are the user's to mend, and the one line that says how."""

import difflib
import errno
import logging
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import torch
import yaml
from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from .errors import UserError

ELSEWHERE = "set paths.data, paths.runs and paths.encoders to folders that can be written to"
DISK = {
    errno.ENOSPC: "the disk is full; free some space and run it again",
    errno.EDQUOT: "the disk quota is used up; free some space and run it again",
    errno.EROFS: f"the disk is read-only; {ELSEWHERE}",
    errno.EACCES: f"no permission; {ELSEWHERE}",
    errno.EPERM: f"no permission; {ELSEWHERE}",
    errno.ENOTDIR: f"not a folder; {ELSEWHERE}",
    errno.EEXIST: f"a file is in the way; move it, or {ELSEWHERE}",
}
GO_ON = "the same command goes on from what is finished"
INTERRUPTED = f"interrupted; {GO_ON}"
TERMINATED = f"the system ended the program (SIGTERM); {GO_ON}"
MORE = {"hydra/launcher": "; pip install -e '.[launchers]' or '.[ray]' brings more"}
SMALLER = (
    "lower data.batch_size and raise trainer.accumulate_grad_batches by the same factor, which "
    "keeps the samples of an optimisation step, or set model.checkpointing=true"
)
GPU_MEMORY = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "MPS backend out of")
HOST_MEMORY = (
    *("DefaultCPUAllocator: can't allocate memory", "Caught MemoryError in DataLoader worker"),
    *("is killed by signal: Killed", "is killed by signal: Bus error"),
)
"""What PyTorch calls it where it has no class for it. Linux kills the process that wants more than
there is, and ends one with a bus error whose shared memory is full."""
BARE_WORD = "Unsupported item value in defaults : bool"
"""How Hydra begins its complaint about one."""


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Ends the program with one line on a user's mistake; a bug keeps its traceback.

    The line goes to standard error. The exit status is 2, 130 after Ctrl-C, or 143 where the system
    ended a training (SIGTERM).
    """
    try:
        yield
    except KeyboardInterrupt:
        _leave(INTERRUPTED, status=130)
    except SystemExit as stop:
        if type(stop).__module__.startswith("lightning."):  # whose import would take seconds here
            _leave(TERMINATED, status=143)
        if not isinstance(stop.__context__, KeyboardInterrupt):
            raise
        _leave(INTERRUPTED, status=130)  # Lightning's way of ending a training on Ctrl-C
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
        if _lacks_memory(cause, torch.OutOfMemoryError, GPU_MEMORY):
            return f"out of GPU memory: {SMALLER}"
        no_fork = isinstance(cause, OSError) and cause.errno == errno.ENOMEM
        if no_fork or _lacks_memory(cause, MemoryError, HOST_MEMORY):
            return (
                f"out of memory: in training {SMALLER}; with many processes lower data.workers "
                "(the loader) or sim.workers (the generation)"
            )
    for cause in chain:
        if told := _unreadable_words(cause):
            return told
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


def _unreadable_words(error: BaseException) -> str | None:
    """What to say of a word of the command line, or a file of ``conf/``, that cannot be read."""
    if isinstance(error, OverrideParseException):
        return f"{error.override!r}: cannot be read; write key=value, and lists without spaces"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
        mark = error.problem_mark
        return f"{mark.name}, line {mark.line + 1}: cannot be read as YAML ({error.problem})"
    if isinstance(error, ValueError) and str(error).startswith(BARE_WORD):
        return (
            "a chosen file has a bare on, off, yes or no in its defaults, which YAML takes "
            'for true or false; write it in quotes, as in override /loss/lovasz: "off"'
        )
    return None


def _lacks_memory(error: BaseException, kind: type, phrases: Iterable[str]) -> bool:
    said = isinstance(error, RuntimeError) and any(phrase in str(error) for phrase in phrases)
    return isinstance(error, kind) or said


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
    known = ", ".join(options) + MORE.get(group, "")
    return f"{group}: there is no {name!r}{closest(name, options)} there are {known}"


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
