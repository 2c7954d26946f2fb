"""task=flights: what perceptions cost in flight, side by side, with paired intervals."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import torch
from omegaconf import DictConfig

from ..errors import UserError
from ..results.files import write_table
from ..results.flights import ALL, FLIGHTS, flight_scores
from ..results.render import Cell, Table, print_table
from ..terminal import say

BEST = {
    **dict.fromkeys(("success", "success_by_time"), "high"),
    **dict.fromkeys(("collisions", "excess_collisions", "stuck", "near"), "low"),
}
PRINTED = tuple(BEST)


def flights(cfg: DictConfig, flights: list[str], reference: str, resamples: int, out: str) -> None:
    """Writes ``scores.csv`` to ``out``, and prints the main ones.

    ``flights`` are folders of `task=fly`, ``reference`` the name of the perception that others are
    compared with. Raises `UserError` without a folder, for one without flights, and for flights of
    other missions.
    """
    if not flights:
        raise UserError("task.flights: name a folder or more, as task.flights=[runs/flights/seen]")
    table = print_scores(dict(map(_read, flights)), reference, resamples)
    write_table(table, Path(out) / "scores.csv")
    say(Path(out) / "scores.csv")


def print_scores(
    flights: Mapping[str, pd.DataFrame], reference: str | None, resamples: int
) -> pd.DataFrame:
    """Prints the main `flight_scores`, a table a stratum, and returns all of them."""
    generator = torch.Generator().manual_seed(0)
    table = flight_scores(flights, reference, resamples, generator)
    for stratum in dict.fromkeys(table["stratum"]):
        print_table(_printed(table[table["stratum"] == stratum], stratum))
    return table


def _read(folder: str) -> tuple[str, pd.DataFrame]:
    """Returns the perception's name, and its flights."""
    path = Path(folder) / FLIGHTS
    if not path.is_file():
        raise UserError(f"task.flights: {folder} has no {FLIGHTS}; make it by task=fly")
    table = pd.read_csv(path, keep_default_na=False)
    return str(table["perception"].iloc[0]), table


def _printed(table: pd.DataFrame, stratum: str) -> Table:
    """Returns the main scores in percent with their intervals, a row a perception."""
    percent = table.set_index(["perception", "score"])[["value", "low", "high"]] * 100
    # One perception alone has no differences.
    shown = [score for score in PRINTED if score in set(table["score"])]
    rows = []
    for name in dict.fromkeys(table["perception"]):
        cells = [
            Cell(*percent.loc[(name, score)], signed=score.startswith("excess"))
            if (name, score) in percent.index
            else None
            for score in shown
        ]
        rows.append((name, cells))

    over = "all" if stratum == ALL else stratum
    title = f"Flights (%), {over}: {table['flights'].iloc[0]} missions, intervals over maps"
    return Table("flights", title, "", shown, rows, "perception", BEST)
