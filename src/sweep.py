"""A sweep: its jobs checked before the first one starts, each of them done, and a summary."""

import os
import re
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from .errors import UserError
from .failures import one_line, quiet_libraries
from .settings import adopted, do_task, expand_home, require_sound, search_path
from .terminal import say
from .values import TRAINING

FINISHED = "finished"
CAUSE = re.compile(r"\w(Error|Exception|Exit)\b|\b(error|killed|cancelled|limit)\b", re.IGNORECASE)
# In the environment: how many jobs the sweep has.
JOBS = "SKYSHIELD_JOBS"
# These tasks write to the folder of the run whose checkpoint they use.
OF_RUN = (
    *(f"src.tasks.{task}.{task}" for task in ("test", "calibrate", "predict", "export")),
    *("studies.attitude.task.attitude", "studies.free_bias.task.free_bias"),
)


class Outcome(NamedTuple):
    """How a job ended, in a few words."""

    summary: str
    failed: bool = False


def require_sound_jobs(jobs: Sequence[DictConfig]) -> None:
    """Raises `UserError` for a mistake in any job, and where two of them would write one folder.

    Each is the composed configuration of a job, Hydra's own part included.
    """
    overrides = [list(cfg.hydra.overrides.task) for cfg in jobs]
    first_in: dict[tuple, str] = {}
    for cfg, label in zip(jobs, labels_of(overrides)):
        require_sound(cfg, cfg.hydra)
        if cfg.task._target_ not in (*OF_RUN, TRAINING):
            continue

        # A checkpoint that is named as a file has a folder of its own, and these below it.
        expand_home(cfg)
        run = adopted(cfg, cfg.hydra.overrides.task).paths.run
        trains = cfg.task._target_ == TRAINING
        apart = () if trains else (cfg.calibrated, cfg.predictions, cfg.task.get("part"))
        first = first_in.setdefault((run, *apart), label)
        if first != label and not trains:
            raise UserError(
                f"{first!r} and {label!r} would both write to {run}; give them one by one, and "
                "move away what each has written"
            )
        if first != label:
            raise UserError(
                f"paths.run: {first!r} and {label!r} would both train in {run}; let "
                "name tell them apart, in the files of the experiments or as "
                "'name=lr${optimizer.lr}' does"
            )


def do_job(cfg: DictConfig) -> Outcome:
    """Does the task of one job, in whatever process its launcher has chosen; says which it is.

    A failure is told at once, as `told_in_one_line` would, but ends this job alone.
    """
    quiet_libraries()
    try:
        of_hydra = HydraConfig.get()
        own = " ".join(of_hydra.overrides.task)
        say(f"job {of_hydra.job.num + 1} of {os.environ.get(JOBS, '?')}: {own}")
        with _as_if_alone([*search_path(of_hydra), *of_hydra.overrides.task]):
            return Outcome(do_task(cfg, of_hydra) or FINISHED)
    except Exception as error:
        message = one_line(error)
        if message is None:
            traceback.print_exc()
            message = " ".join(f"{type(error).__name__}: {error}".split())

        print(f"error: {message}", file=sys.stderr, flush=True)
        return Outcome(f"failed: {message}", failed=True)


@contextmanager
def _as_if_alone(overrides: Sequence[str]) -> Iterator[None]:
    """Shows the job its own command line, and undoes what it leaves in the environment.

    Lightning starts the other processes of a run with this one's command line, which would be the
    whole sweep. What it writes into the environment of the first run would make the second one wait
    for processes that nobody starts.
    """
    argv, environment = sys.argv[1:], dict(os.environ)
    sys.argv[1:] = overrides
    try:
        yield
    finally:
        sys.argv[1:] = argv
        for name in os.environ.keys() - environment.keys():
            del os.environ[name]
        os.environ.update(environment)


def launcher_failure(error: Exception) -> UserError:
    """Returns the error to raise where a launcher fails, as when a process of its own is killed."""
    first, *lines = f"{type(error).__name__}: {error}".splitlines()
    # Of a process elsewhere: the last line of its traceback, or what its scheduler says.
    causes = [line.strip() for line in lines if CAUSE.search(line) and "job.stderr" not in line]
    if "UncompletedJobError" in first and not causes:
        causes = ["killed (out of memory?), or its time was over"]
    reason = one_line(error) or ": ".join([first.rstrip(": "), *causes[-1:]])
    if not isinstance(error, OSError):
        reason = f"hydra/launcher: {reason}"
    return UserError(f"{reason}; what is finished is kept: the same command goes on from it")


def summarize(jobs: Sequence[Sequence[str]], outcomes: Sequence[Outcome]) -> None:
    """Prints a line for each job. Raises `UserError` where one has failed."""
    for label, outcome in zip(labels_of(jobs), outcomes):
        say(f"{label}: {outcome.summary}")

    failed = sum(outcome.failed for outcome in outcomes)
    if failed:
        raise UserError(
            f"{failed} of {len(jobs)} jobs failed, for the reasons above; the same command tries "
            "them again, and trains nothing that is finished"
        )


def labels_of(jobs: Sequence[Sequence[str]]) -> list[str]:
    """Names each job by the overrides that no other job shares, or by all where it has none."""
    shared = set(jobs[0]).intersection(*jobs) if len(jobs) > 1 else set()
    own = [[override for override in job if override not in shared] or job for job in jobs]
    return [" ".join(override.removeprefix("+") for override in job) for job in own]
