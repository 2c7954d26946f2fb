"""Tasks of a moment, for what is around a task: ``task._target_=tests.stub_tasks.remember``."""

import os
import signal
import sys
import time
from pathlib import Path

from src.errors import UserError


def remember(cfg):
    """Leaves a file named after the seed, which holds the words that the task believes it was
    called with."""
    path = Path(cfg.paths.runs) / f"{cfg.name}{cfg.seed}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(" ".join(sys.argv[1:]))


def fail_between_others(cfg):
    """Seed 1 meets a user's mistake and seed 2 a bug; the others are done."""
    if cfg.seed == 1:
        raise UserError("data.zip: broken; delete it")
    if cfg.seed == 2:
        return 1 / 0
    return remember(cfg)


def be_one_of_many(cfg):
    """Fails where an earlier job has left a rank in the environment; leaves one itself."""
    if "LOCAL_RANK" in os.environ:
        raise UserError("this process is not the first one")
    os.environ["LOCAL_RANK"] = "0"
    remember(cfg)
    return "finished, went on after epoch 1 of 2"


def be_interrupted(cfg):
    """Ctrl-C, in the words of Lightning's trainer."""
    remember(cfg)
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        sys.exit(1)


def sleep(cfg):
    remember(cfg)
    # One write: two jobs share the pipe, and print() writes the end of its line by itself.
    sys.stdout.write("asleep\n")
    sys.stdout.flush()
    time.sleep(120)


def be_killed(cfg):
    os.kill(os.getpid(), signal.SIGKILL)
