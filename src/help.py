"""``python run.py --help``: the tasks, and the keys that people change, told without an import."""

import ast
import os
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
GROUPS = ROOT / "conf"
# What people change first, and what it says; docs/keys.md has more.
KEYS = {
    "+experiment=": "baseline, attitude, weights, skyocc, or a file of your own",
    "scale=  recipe=": "small, tiny, ladder, paper: the sizes; strong, or paper",
    "seed=  name=": "of the training; a name for the run's folder",
    "data.batch_size=  data.workers=": "samples a step; processes that load them",
    "optimizer.lr=  trainer.max_epochs=": "learning rate; passes over the training frames",
    "sim.image.width=  grid.shape=": "pixels; voxels; another value is another dataset",
    "paths.data=  paths.runs=": "folders of all datasets and runs; paths.dataset= is one dataset",
    "ckpt_path=": "best, last or a file, for tasks that need trained weights",
}


def print_help() -> None:
    """Prints `help_text`, to a reader who may have left after its first lines."""
    try:
        print(help_text(), flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def help_text() -> str:
    """Returns what the program says of itself: fewer than 40 lines."""
    lines = ["python run.py [task=TASK] [key=value ...]     -m: a run for each of a,b,c", "Tasks"]
    for task in sorted((GROUPS / "task").glob("*.yaml")):
        lines.append(f"  {task.stem:13} {_purpose(_module(task))}")
    lines += ["", "Keys that people change"]
    lines += [f"  {key:34} {meaning}" for key, meaning in KEYS.items()]
    lines.append(
        "docs/keys.md has more of them, --cfg job has all, and --hydra-help is Hydra's own help."
    )
    return "\n".join(lines)


def _module(task: Path) -> str:
    """Returns the module of the function that a task's file names."""
    return re.search(r"_target_: (\S+)\.\w+", task.read_text(encoding="utf-8")).group(1)


def _purpose(module: str) -> str:
    """Returns the first line of a module's docstring, without the task's name."""
    source = (ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
    first, *_ = ast.get_docstring(ast.parse(source)).splitlines()
    return first.partition(": ")[2].rstrip(".")
