"""task=flights: what perceptions cost in flight, side by side, with paired intervals."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import torch
from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..report.threshold_figure import draw_thresholds
from ..results.files import write_table
from ..results.flights import ALL, FLIGHTS, flight_scores
from ..results.render import Cell, Table, print_table
from ..run_folder import CONFIG
from ..terminal import say

BEST = {
    **dict.fromkeys(("success", "success_by_time"), "high"),
    **dict.fromkeys(("collisions", "excess_collisions", "stuck", "near"), "low"),
}
PRINTED = tuple(BEST)


def flights(cfg: DictConfig, flights: list[str], reference: str, resamples: int, out: str) -> None:
    """Writes ``scores.csv`` to ``out``, and prints the main ones.

    ``flights`` are folders of `task=fly`, ``reference`` the name of the perception that others are
    compared with. One that flew with several thresholds is named with each, and drawn over them to
    ``thresholds.png``. Raises `UserError` without a folder, for one without flights, for one given
    twice, and for flights of other missions.
    """
    if not flights:
        raise UserError("task.flights: name a folder or more, as task.flights=[runs/flights/seen]")
    flown = list(map(_read, flights))
    names = _named([name for name, _, _ in flown], [threshold for _, threshold, _ in flown])
    tables = dict(zip(names, (table for _, _, table in flown)))
    if reference not in tables and reference in (name for name, _, _ in flown):
        several = ", ".join(label for label in names if label.startswith(f"{reference} at "))
        raise UserError(f"task.reference: {reference} flew more than once; name one of {several}")
    table = print_scores(tables, reference, resamples)
    write_table(table, Path(out) / "scores.csv")

    curves: dict[str, dict[float, str]] = {}
    for label, (name, threshold, _) in zip(names, flown):
        curves.setdefault(name, {})[threshold] = label
    if curves := {name: of for name, of in curves.items() if len(of) > 1}:
        draw_thresholds(table, curves, Path(out) / "thresholds.png")
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


def _named(names: list[str], thresholds: list[float]) -> list[str]:
    """Returns a name for each: with its threshold, where a perception flew more than once."""
    labels = [
        f"{name} at {threshold:g}" if names.count(name) > 1 else name
        for name, threshold in zip(names, thresholds)
    ]
    for label in labels:
        if labels.count(label) > 1:
            raise UserError(f"task.flights: {label} is there twice; name each folder once")
    return labels


def _read(folder: str) -> tuple[str, float, pd.DataFrame]:
    """Returns the perception's name, the planner's threshold, and the flights."""
    path = Path(folder) / FLIGHTS
    if not path.is_file():
        raise UserError(f"task.flights: {folder} has no {FLIGHTS}; make it by task=fly")
    table = pd.read_csv(path, keep_default_na=False)
    threshold = OmegaConf.load(Path(folder) / CONFIG).planner.threshold
    return str(table["perception"].iloc[0]), float(threshold), table


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
