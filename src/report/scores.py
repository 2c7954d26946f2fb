"""What a scored run leaves: ``results.csv``, ``scores.csv`` with intervals, and the tallies."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from ..atomic import replacing
from ..metrics.suite import intervals_of
from ..metrics.tally import Tally
from ..run_folder import SCORES as LONG
from ..run_folder import TALLIES
from .results import SCORES

Parts = Mapping[str, Callable[[str], bool]]


def result_rows(tally: Tally, parts: Parts, facts: Mapping[str, object]) -> list[dict]:
    """A row of ``results.csv`` for each part that has a frame; ``facts`` are the other columns."""
    suite = tally.suite()
    rows = []
    for part, chosen in parts.items():
        clips = tally.rows(chosen)
        if not clips:
            continue
        tables = {name: table[clips].sum(0) for name, table in tally.tables["occupancy"].items()}
        scores = suite.metric("occupancy").scores(tables)
        # As the metric itself gives them, to the last bit.
        values = {name: float(scores[name].float()) for name in SCORES}
        protocol = tally.protocol.to_json()
        rows.append(
            {**facts, "experiment": tally.name, "split": part, **values, "protocol": protocol}
        )
    return rows


def score_table(tallies: Sequence[Tally], parts: Parts) -> pd.DataFrame:
    """A row for each experiment, part and score: its value and the interval over clips."""
    rows = []
    for tally in tallies:
        suite, settings = tally.suite(), tally.protocol.suite
        how = (settings["resamples"], settings["seed"], settings["level"])
        for part, chosen in parts.items():
            clips = tally.rows(chosen)
            if not clips:
                continue
            frames = sum(tally.frames[row] for row in clips)
            for score, found in intervals_of(suite, tally.tables, clips, *how).items():
                rows.append((tally.name, part, score, *found, len(clips), frames))
    columns = ["experiment", "split", "score", "value", "low", "high", "clips", "frames"]
    return pd.DataFrame(rows, columns=columns)


def write_scores(folder: Path, tallies: Sequence[Tally], parts: Parts) -> pd.DataFrame:
    """Write ``scores.csv`` and ``tallies/<experiment>.npz`` into a folder; returns the table.

    Each file is replaced as a whole. Raises `UserError` where one cannot be written.
    """
    for tally in tallies:
        tally.write(folder / TALLIES / f"{tally.name}.npz")
    table = score_table(tallies, parts)
    write_table(table, folder / LONG)
    return table


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a CSV; the file is replaced as a whole. Raises `UserError` where it cannot be."""
    with replacing(path) as temporary:
        table.to_csv(temporary, index=False, lineterminator="\n")
