"""task=flights: what perceptions cost in flight, side by side, with paired intervals."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import torch
from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..report.threshold_figure import draw_thresholds
from ..results.archive import unpacked
from ..results.files import write_table
from ..results.flights import ALL, FLIGHTS, flight_scores
from ..results.render import Cell, Table, print_table
from ..run_folder import CONFIG
from ..terminal import say

# What the names of a model's trainings end with.
SEED = re.compile(r"-seed\d+$")
BEST = {
    **dict.fromkeys(("success", "success_by_time"), "high"),
    **dict.fromkeys(("collisions", "excess_collisions", "stuck", "near"), "low"),
}
PRINTED = tuple(BEST)


class Flown(NamedTuple):
    """The flights of a perception with a threshold of the planner, and its name without a seed."""

    name: str
    family: str
    threshold: float
    table: pd.DataFrame


def flights(cfg: DictConfig, flights: list[str], reference: str, resamples: int, out: str) -> None:
    """Writes ``scores.csv`` to ``out``, and prints the main ones.

    ``flights`` are folders of `task=fly`; or folders of several, and archives of such, of which
    every set ``flown`` is read. ``reference`` is the name of the perception that others are
    compared with. Several seeds of a model, ``<name>-seed<k>``, are one perception. One that flew
    with several thresholds is named with each, and drawn over them to ``thresholds.png``.

    Raises `UserError` without a folder, for one without flights, for one given twice, and for
    flights of other missions.
    """
    if not flights:
        raise UserError("task.flights: name a folder or more, as task.flights=[runs/flights/seen]")
    with unpacked([Path(each) for each in flights]) as (places, _):
        flown = [each for place in places for each in _read(place)]
    labels = _labels(flown)
    tables = {label: [flown[n].table for n in places] for label, places in labels.items()}
    if reference not in tables and reference in {each.family for each in flown}:
        several = ", ".join(label for label in labels if label.startswith(f"{reference} at "))
        raise UserError(f"task.reference: {reference} flew more than once; name one of {several}")
    table = print_scores(tables, reference, resamples)
    write_table(table, Path(out) / "scores.csv")

    curves: dict[str, dict[float, str]] = {}
    for label, (first, *_) in labels.items():
        curves.setdefault(flown[first].family, {})[flown[first].threshold] = label
    if curves := {name: of for name, of in curves.items() if len(of) > 1}:
        draw_thresholds(table, curves, Path(out) / "thresholds.png")
    say(Path(out) / "scores.csv")


def print_scores(
    flights: Mapping[str, Sequence[pd.DataFrame]], reference: str | None, resamples: int
) -> pd.DataFrame:
    """Prints the main `flight_scores`, a table a stratum, and returns all of them."""
    generator = torch.Generator().manual_seed(0)
    table = flight_scores(flights, reference, resamples, generator)
    for stratum in dict.fromkeys(table["stratum"]):
        print_table(_printed(table[table["stratum"] == stratum], stratum))
    return table


def _read(place: Path) -> Iterator[Flown]:
    """Yields the flights of a folder of `task=fly`, or of all sets ``flown`` below a folder."""
    alone = place / FLIGHTS
    paths = [alone] if alone.is_file() else sorted(place.rglob(f"flown/{FLIGHTS}"))
    if not paths:
        raise UserError(f"task.flights: {place} has no {FLIGHTS}; make it by task=fly")
    for path in paths:
        table = pd.read_csv(path, keep_default_na=False)
        name = str(table["perception"].iloc[0])
        threshold = float(OmegaConf.load(path.parent / CONFIG).planner.threshold)
        yield Flown(name, SEED.sub("", name), threshold, table)


def _labels(flown: Sequence[Flown]) -> dict[str, list[int]]:
    """Returns the places of a perception's seeds by its name: with its threshold, where it flew
    with several, and with its seed, where that is the only one."""
    found: dict[str, list[int]] = {}
    for n, each in enumerate(flown):
        alike = [other for other in flown if other.family == each.family]
        seeds = {other.name for other in alike}
        label = each.family if len(seeds) > 1 else each.name
        if len({other.threshold for other in alike}) > 1:
            label += f" at {each.threshold:g}"
        if each.name in (flown[place].name for place in found.get(label, ())):
            raise UserError(
                f"task.flights: {each.name} at {each.threshold:g} is there twice; name each folder "
                "once"
            )
        found.setdefault(label, []).append(n)
    return found


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
    if table["seeds"].max() > 1:
        title += " and seeds"
    return Table("flights", title, "", shown, rows, "perception", BEST)
