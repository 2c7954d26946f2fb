"""Failures that the user can mend, each told in one line that says how."""

import errno
import logging
import os
import re
import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import torch
import yaml
from hydra import errors as hydra
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from .errors import UserError, closest, reason_of
from .help import GROUPS

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
NO_REASON = ", set env var HYDRA_FULL_ERROR=1 to see chained exception."
# What is raised for a module or a class that there is not.
ABSENT = (ImportError, AttributeError)
# Packages that only the generation of data needs, and that not every platform has.
GENERATORS = ("pybullet", "embreex")
# In a file's name, these end what Hydra takes for a value.
QUOTED = "=~ ()[]{}&;#!' or an accent"
PLAIN = re.compile(r"[\w./:,+@%-]*", re.ASCII)
MERGING = (
    ": what stands there is of another kind; choose an option of its group whose value is of this "
    "kind first, as loss/class_weights=manual for class weights"
)
GO_ON = "the same command goes on from what is finished"
ENDED = f"the system ended the program (SIGTERM); {GO_ON}"
SMALLER = (
    "lower data.batch_size and raise trainer.accumulate_grad_batches by the same factor, which "
    "keeps the samples of an optimization step, or set model.checkpointing=true"
)
# PyTorch has no class for these. Linux kills the process that wants more memory than there is, and
# ends one with a bus error whose shared memory is full.
GPU_MEMORY = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "MPS backend out of")
HOST_MEMORY = (
    "DefaultCPUAllocator: can't allocate memory",
    "Caught MemoryError in DataLoader worker",
    "is killed by signal: Killed",
)
SHM, NO_ROOM = "/dev/shm", 2**20
SHARED_MEMORY = (
    "is killed by signal: Bus error",
    "torch_shm_manager",
    "unable to write to file </torch",
    "unable to allocate shared memory(shm)",
)


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Ends the program with one line on a user's mistake; a bug keeps its traceback.

    The line goes to standard error. The exit status is 2, 130 after Ctrl-C, or 143 where the system
    ended a training (SIGTERM).
    """
    try:
        yield
    except _Told:
        raise
    except (KeyboardInterrupt, SystemExit) as stop:
        if type(stop).__module__.startswith("lightning."):  # whose import would take seconds here
            _leave(ENDED, status=143)
        # Lightning ends a training on Ctrl-C with an exit of its own.
        if KeyboardInterrupt not in (type(stop), type(stop.__context__)):
            raise
        _leave(f"interrupted; {GO_ON}", status=130)
    except Exception as error:
        message = one_line(error)
        if message is None:
            raise
        _leave(message, status=143 if message == ENDED else 2)


class _Told(SystemExit):
    """The end of the program, whose reason has been printed."""


def _leave(message: str, status: int) -> None:
    print(f"error: {message}", file=sys.stderr)
    raise _Told(status)


def one_line(error: BaseException) -> str | None:
    """Returns the message for a user's mistake, or ``None`` where the program is at fault."""
    chain = [error]
    while (cause := chain[-1].__cause__ or chain[-1].__context__) and cause not in chain:
        chain.append(cause)

    for message_of in (_of_run, _of_files):
        for cause in chain:
            if message := message_of(cause):
                return message
    return _of_configuration(chain)


def _of_run(cause: BaseException) -> str | None:
    """Returns the message for a mistake that the program names, or for a lack of disk or memory."""
    if isinstance(cause, UserError):
        # From a loader's worker the message arrives as that process's whole traceback.
        return str(cause).strip().splitlines()[-1].removeprefix("src.errors.UserError: ")
    if isinstance(cause, ModuleNotFoundError) and cause.name in GENERATORS:
        return (
            f"{cause.name} is not installed, and this task needs it: give make setup, which says "
            "where there is none, and what works without; training does, with paths.dataset=DIR"
        )
    if _lacks_memory(cause, (), SHARED_MEMORY) or _is_of_shared_memory(cause):
        return (
            "shared memory (/dev/shm) is too small for the loader's processes: give more, as with "
            "docker run --shm-size=2g, or data.workers=0"
        )
    # One that is sent to all processes ends the loader's first.
    if isinstance(cause, RuntimeError) and "is killed by signal: Terminated" in str(cause):
        return ENDED
    if isinstance(cause, OSError) and cause.errno in DISK:
        return f"{cause.filename or 'writing'}: {DISK[cause.errno]}"

    # Of Lightning, whose import would take seconds here.
    if type(cause).__name__ == "MisconfigurationException":
        return f"trainer or callbacks: {reason_of(cause)}; see conf/trainer and conf/callbacks"

    if _lacks_memory(cause, torch.OutOfMemoryError, GPU_MEMORY):
        return f"out of GPU memory: {SMALLER}"
    cannot_fork = isinstance(cause, OSError) and cause.errno == errno.ENOMEM
    if cannot_fork or _lacks_memory(cause, MemoryError, HOST_MEMORY):
        return (
            f"out of memory: in training {SMALLER}; with many processes lower data.workers "
            "(the loader) or sim.workers (the generation)"
        )
    return None


def _is_of_shared_memory(cause: BaseException) -> bool:
    """Tells whether the disk that is full is that of the shared memory."""
    if not isinstance(cause, OSError) or cause.errno != errno.ENOSPC:
        return False
    if cause.filename is not None:
        return str(cause.filename).startswith(SHM)
    # A semaphore that finds no room has no name.
    return os.path.isdir(SHM) and shutil.disk_usage(SHM).free < NO_ROOM


def _lacks_memory(cause: BaseException, kind: type | tuple[()], phrases: Iterable[str]) -> bool:
    has_phrase = any(phrase in str(cause) for phrase in phrases)
    return isinstance(cause, kind) or (isinstance(cause, RuntimeError) and has_phrase)


def _of_files(cause: BaseException) -> str | None:
    """Returns the message for an override or a file of ``conf/`` that cannot be read."""
    if isinstance(cause, hydra.OverrideParseException):
        key, _, value = cause.override.partition("=")
        way_out = "write key=value, and lists without spaces"
        if value[:1] not in ("[", "{") and not PLAIN.fullmatch(value):
            way_out = f"a value with one of {QUOTED} wants quotes, as in '{key}=\"{value}\"'"
        elif value[:1] == "[" and not PLAIN.fullmatch(value.strip("[]")):
            way_out = f'a word with one of {QUOTED} wants quotes, as in \'{key}=["a=1","~/b"]\''
        return f"{cause.override!r}: cannot be read; {way_out}"

    if isinstance(cause, yaml.MarkedYAMLError) and cause.problem_mark:
        mark = cause.problem_mark
        return f"{mark.name}, line {mark.line + 1}: cannot be read as YAML ({cause.problem})"

    if isinstance(cause, ValueError) and "Unsupported item value in defaults : bool" in str(cause):
        return (
            "a chosen file has a bare on, off, yes or no in its defaults, which YAML takes "
            'for true or false; write it in quotes, as in override /loss/lovasz: "off"'
        )
    if isinstance(cause, ValueError) and "Config group override must be" in str(cause):
        return "a group was given null; choose one of its options, as those of conf/GROUP"
    return None


def _of_configuration(chain: list[BaseException]) -> str | None:
    """Returns the message for an option or a key that there is not."""
    composing = any(isinstance(cause, hydra.ConfigCompositionException) for cause in chain)
    for cause in reversed(chain):
        if isinstance(cause, hydra.MissingConfigException) and cause.missing_cfg_file:
            return _no_such_option(cause)
        if isinstance(cause, ConfigAttributeError | ConfigKeyError) and composing:
            return _no_such_key(cause)

    for cause in chain:
        if isinstance(cause, ConfigAttributeError):
            return None  # the program asks for a key that no configuration has
        if isinstance(cause, hydra.HydraException | OmegaConfBaseException):
            message = " ".join(str(cause).split())
            root = cause
            while root.__cause__:  # not its context: Hydra imports while it handles another error
                root = root.__cause__
            if message.startswith("Error locating") and not isinstance(root, ABSENT):
                return None  # the file is there, and has a mistake
            message = message.replace(NO_REASON, f" ({reason_of(root)});").rstrip(";")
            return message + (MERGING if message.startswith("Error merging override") else "")
    return None


def _no_such_option(error: hydra.MissingConfigException) -> str:
    group, _, name = error.missing_cfg_file.rpartition("/")
    options = error.options or []
    known = ", ".join(options)
    if group == "hydra/launcher":
        known += "; pip install -e '.[launchers]' or '.[ray]' brings more"
    return f"{group}: there is no {name!r}{closest(name, options)} there are {known}"


def _no_such_key(error: ConfigAttributeError | ConfigKeyError) -> str:
    name = str(error.full_key).rpartition(".")[2]
    parent = error.parent_node
    siblings = list(map(str, parent)) if isinstance(parent, DictConfig) else []
    if "/" in name:  # a group was meant
        folders = (path for path in GROUPS.rglob("*") if path.is_dir())
        siblings = sorted(str(path.relative_to(GROUPS)) for path in folders)
    known = ", ".join(siblings)
    return f"{error.full_key}: no such key{closest(name, siblings)} there are {known}"


def quiet_libraries() -> None:
    """Leaves the output to the program: only warnings of libraries pass, and not Lightning's."""
    logging.disable(logging.INFO)  # Lightning sets its loggers' levels when it is imported
    warnings.filterwarnings("ignore", module=r"(lightning|torchmetrics|torch)\.")
