"""task=sensitivity: how KAR-mIoU and the ranking of runs depend on its four parameters."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from src.errors import UserError
from src.metrics.suite import import_metrics
from src.results.counts import Counts, require_comparable
from src.results.files import write_table
from src.results.scored import read_scored
from src.terminal import say
from studies.sensitivity.figure import draw_sensitivity

METRIC = "sensitivity"
# Scores are ranked to this many digits: those of the same labels differ by some 1e-11 between a
# run, whose batches hold the velocity in float32, and task=score, which has it in float64.
DECIMALS = 9


def sensitivity(cfg: DictConfig, runs: list[str], out: str) -> None:
    """Writes ``sensitivity.csv`` and ``sensitivity.png`` to ``out``, and says how many orders of
    the runs there are.

    Raises `UserError` without runs, for runs of other protocols, clips or labels, and for a run
    that was scored without ``suite=sensitivity``.
    """
    import_metrics(cfg.suite)
    if not runs:
        raise UserError("task.runs: name one or more, as task.runs=[A,B]")
    scored = read_scored(list(map(str, runs)))
    require_comparable(scored)

    table, folder = sensitivity_table(scored), Path(out)
    write_table(table, folder / "sensitivity.csv")
    draw_sensitivity(table, list(scored), folder / "sensitivity.png")
    orders = len(table[[f"rank {name}" for name in scored]].drop_duplicates())
    say(f"orders of the runs under {len(table)} settings of KAR-mIoU: {orders}")
    say(folder)


def sensitivity_table(runs: Mapping[str, Counts]) -> pd.DataFrame:
    """KAR-mIoU of every run, and its rank, with a row for each combination of parameters."""
    for name, counts in runs.items():
        if METRIC not in counts.tables:
            raise UserError(
                f"{name}: has no counts for other parameters; score it again with suite=sensitivity"
            )
    table = next(iter(runs.values())).suite().metric(METRIC).settings

    scores = pd.DataFrame(
        {name: map(float, counts.scores(METRIC).values()) for name, counts in runs.items()}
    )
    ranks = scores.round(DECIMALS).rank(axis=1, ascending=False, method="min").astype("Int64")
    return pd.concat([table, scores, ranks.add_prefix("rank ")], axis=1)
