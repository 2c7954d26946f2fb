"""task=flights: what perceptions cost in flight, side by side, with paired intervals."""

import fnmatch
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd
import torch
from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..report.threshold_figure import draw_thresholds
from ..results.files import write_table
from ..results.flights import ALL, FLIGHTS, Flights, flight_scores, read_flights
from ..results.render import Cell, Table, print_table, with_recipes
from ..run_folder import CONFIG
from ..terminal import say

# What the names of a model's trainings end with.
SEED = re.compile(r"-seed\d+$")
BEST = {
    **dict.fromkeys(("success", "success_by_time"), "high"),
    **dict.fromkeys(("collisions", "excess_collisions", "stuck", "near"), "low"),
}
PRINTED = tuple(BEST)


def flights(
    cfg: DictConfig,
    flights: Sequence[str],
    reference: str,
    resamples: int,
    out: str,
    perceptions: Sequence[str] = (),
) -> None:
    """Writes ``scores.csv`` to ``out``, and prints the main ones.

    ``flights`` are folders of `task=fly`; folders of several, of which every set ``flown`` is read;
    or tables of several, whose columns ``name`` and ``threshold`` tell them apart. Of
    ``perceptions``, patterns such as ``skyocc-*``, those are read whose name matches one; without
    any, all. ``reference`` is the name of the perception that others are compared with. Several
    seeds of a model, ``<name>-seed<k>``, are one perception. One that flew with several thresholds
    is named with each, and drawn over them to ``thresholds.png``.

    Raises `UserError` without a folder, for one without flights, for one given twice, for a pattern
    that matches nothing, and for flights of other missions.
    """
    if not flights:
        raise UserError("task.flights: name a folder or more, as task.flights=[runs/flights/seen]")
    read = [each for place in flights for each in _read(Path(place))]
    flown = _together(_chosen(read, perceptions))
    labels = {
        name: {each: f"{name} at {each:g}" if len(of_name) > 1 else name for each in of_name}
        for name, of_name in flown.items()
    }
    tables = {labels[name][each]: own for name, of in flown.items() for each, own in of.items()}
    if reference in flown and reference not in tables:
        several = ", ".join(labels[reference].values())
        raise UserError(f"task.reference: {reference} flew more than once; name one of {several}")
    if reference not in tables:
        say(f"task.reference: {reference} is not among them, so there are no differences")
    table = print_scores(tables, reference, resamples)
    write_table(table, Path(out) / "scores.csv")

    if curves := {name: of for name, of in labels.items() if len(of) > 1}:
        draw_thresholds(table, curves, Path(out) / "thresholds.png")
    say(Path(out) / "scores.csv")


def print_scores(flights: Flights, reference: str | None, resamples: int) -> pd.DataFrame:
    """Prints the main `flight_scores`, a table a stratum, and returns all of them."""
    generator = torch.Generator().manual_seed(0)
    table = flight_scores(flights, reference, resamples, generator)
    for stratum in dict.fromkeys(table["stratum"]):
        print_table(_printed(table[table["stratum"] == stratum], stratum))
    return table


def _read(place: Path) -> Iterator[tuple[str, float, pd.DataFrame]]:
    """Yields the name of the flights, the planner's threshold and the flights: of a folder of
    `task=fly`, of all sets ``flown`` below a folder, or of a table of several."""
    if place.is_file():
        yield from _tables(place)
        return
    alone = place / FLIGHTS
    paths = [alone] if alone.is_file() else sorted(place.rglob(f"flown/{FLIGHTS}"))
    if not paths:
        raise UserError(f"task.flights: {place} has no {FLIGHTS}; make it by task=fly")

    for path in paths:
        table, config = read_flights(path), path.parent / CONFIG
        settings = OmegaConf.load(config) if config.is_file() else OmegaConf.create()
        if (threshold := OmegaConf.select(settings, "planner.threshold")) is None:
            raise UserError(f"{config}: lacks planner.threshold; keep it beside its {FLIGHTS}")
        yield str(table["perception"].iloc[0]), float(threshold), table


def _tables(path: Path) -> Iterator[tuple[str, float, pd.DataFrame]]:
    """Yields the same as `_read`, from the flights ``flown`` of a published table."""
    table = read_flights(path)
    if lacking := [name for name in ("frames", "name", "threshold") if name not in table]:
        raise UserError(
            f"task.flights: {path} has no column {lacking[0]}; of flights of your own give the "
            "folder"
        )
    groups = table[table["frames"] == "flown"].groupby(["name", "threshold"], sort=False)
    for (name, threshold), own in groups:
        yield str(name), float(threshold), own


def _chosen(
    read: Sequence[tuple[str, float, pd.DataFrame]], perceptions: Sequence[str]
) -> list[tuple[str, float, pd.DataFrame]]:
    """Keeps the flights whose name matches one of some patterns, or all without any; what they are
    then called is their perception."""
    names = [name for name, _, _ in read]
    for pattern in perceptions:
        if not fnmatch.filter(names, pattern):
            raise UserError(
                f"task.perceptions: none is called {pattern!r}; there are {', '.join(names)}"
            )

    wanted = {name for pattern in perceptions or ["*"] for name in fnmatch.filter(names, pattern)}
    return [
        (str(table["perception"].iloc[0]), threshold, table)
        for name, threshold, table in read
        if name in wanted
    ]


def _together(
    flown: Sequence[tuple[str, float, pd.DataFrame]],
) -> dict[str, dict[float, dict[str, pd.DataFrame]]]:
    """Returns the flights by perception, threshold and seed. A model with one seed keeps its name
    with it."""
    by_model: dict[tuple[str, float], dict[str, pd.DataFrame]] = {}
    for name, threshold, table in flown:
        seeds = by_model.setdefault((SEED.sub("", name), threshold), {})
        if name in seeds:
            raise UserError(
                f"task.flights: {name} at {threshold:g} is there twice; name each folder once"
            )
        seeds[name] = table

    found: dict[str, dict[float, dict[str, pd.DataFrame]]] = {}
    for (model, threshold), seeds in by_model.items():
        name = model if len(seeds) > 1 else next(iter(seeds))
        own = {each.removeprefix(f"{model}-seed"): table for each, table in seeds.items()}
        found.setdefault(name, {})[threshold] = own
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
    recipes = table.drop_duplicates("perception")["recipe"].tolist()
    return with_recipes(Table("flights", title, "", shown, rows, "perception", BEST), recipes)
