"""What each change by itself does to the learning, on validation alone.

    python -m studies.learning [--jobs N] [--out FOLDER] [--plan FILE] [OVERRIDE...]

Trains the changes of the plan, by default ``plan.yaml``, with each of its seeds, ``--jobs`` at
a time, as ``run.py`` would; the overrides are added to all of them. A row is added to
``FOLDER/trials.csv`` as soon as a training has ended, and what has a row there is not trained
again, so it can be interrupted. Prints the table of means. The runs lie in ``runs/learning``.
"""

import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from threading import Lock

import pandas as pd

from src.errors import UserError
from src.provenance import SOURCE, git_commit
from src.results.files import write_table
from src.terminal import say
from studies.settings import read_plan, run
from studies.tables import print_table

RUNS = "runs/learning"
PLAN = Path(__file__).with_name("plan.yaml")
SCORES = {
    "KAR-mIoU": "val/kar_miou",
    "thin structure": "val/iou/thin_structure",
    "car": "val/iou/car",
    "VRU": "val/iou/vru",
}
"""Columns of the table, in percent, and where a run logs them."""
DEPTH = {"depth error": "val/depth_error"}


class Trials:
    """The table of all trainings so far; a file that several threads add rows to."""

    def __init__(self, folder: Path) -> None:
        self.path, self.lock = folder / "trials.csv", Lock()
        self.table = pd.read_csv(self.path) if self.path.is_file() else pd.DataFrame()

    def add(self, row: dict[str, object]) -> None:
        with self.lock:
            self.table = pd.concat([self.table, pd.DataFrame([row])], ignore_index=True)
            write_table(self.table, self.path)


def train(trials: Trials, change: str, seed: int, overrides: list[str]) -> None:
    """Trains one change with one seed, and adds its best epoch by validation."""
    name = re.sub(r"\W+", "_", change, flags=re.ASCII)
    words = [*overrides, f"name={name}", f"seed={seed}", f"paths.runs={RUNS}"]
    start_s = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "run.py", *words], cwd=SOURCE.parent, capture_output=True, text=True
    )
    if done.returncode:
        reason = done.stderr.strip().splitlines()[-1:] or ["no reason was given"]
        raise UserError(f"{change}, seed {seed}: {reason[0].removeprefix('error: ')}")

    (log,) = (SOURCE.parent / RUNS).glob(f"*/{name}/seed{seed}/metrics.csv")
    epochs = pd.read_csv(log).dropna(subset=["val/kar_miou"])
    best = epochs.loc[epochs["val/kar_miou"].idxmax()]
    scores = {column: round(100 * best[key], 2) for column, key in SCORES.items()}
    # A network that says nothing of its pixels has no error of their depth.
    scores |= {column: round(best[key], 4) for column, key in DEPTH.items() if key in best}
    minutes = {"minutes": round((time.perf_counter() - start_s) / 60, 1), "commit": git_commit()}
    trials.add({"change": change, "seed": seed, **scores, **minutes})
    say(f"{change}, seed {seed}: KAR-mIoU {scores['KAR-mIoU']} %")


def table_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each change: the means over its seeds, and their range for the score."""
    columns = [*SCORES, *DEPTH]
    by_change = trials.groupby("change", sort=False)
    table, score = by_change[columns].mean().round(3), by_change["KAR-mIoU"]
    ranges = [f"{low:.1f} to {high:.1f}" for low, high in zip(score.min(), score.max())]
    table.insert(1, "range", ranges)
    table["seeds"], table["minutes"] = by_change.size(), by_change["minutes"].median()
    return table.round({name: 1 for name in SCORES})


def main(
    *overrides: str,
    jobs: int = 2,
    out: Path = Path(__file__).parent,
    plan: Path = PLAN,
) -> None:
    planned, trials = read_plan(plan, "overrides", "seeds", "changes"), Trials(out)
    shared, pool = [*planned["overrides"], *overrides], ThreadPoolExecutor(jobs)
    table = trials.table.reindex(columns=["change", "seed"])
    done = set(table.itertuples(index=False, name=None))
    # All changes with the first seed come first: an interrupted study compares something.
    trainings = [
        pool.submit(train, trials, change, seed, [*shared, *own])
        for seed, (change, own) in product(planned["seeds"], planned["changes"].items())
        if (change, seed) not in done
    ]
    try:
        for training in trainings:
            training.result()
    finally:
        # After a mistake or Ctrl-C what has not begun does not begin.
        pool.shutdown(cancel_futures=True)

    table = table_of(trials.table)
    rows = table.reset_index().map(lambda cell: "" if pd.isna(cell) else str(cell)).values
    print_table("means over the seeds, on validation", ("change", *table), rows)


if __name__ == "__main__":
    run(main)
