"""A table to be shown, and its forms: CSV, and on the terminal; `latex` has another one."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import NamedTuple

import pandas as pd
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from ..run_folder import NO_RECIPE

# A score that does not exist.
NONE = "–"

# Width of a printed table in columns, and of its names, which are folded.
WIDTH, NAME_WIDTH = 110, 30
# Room to measure how wide a table would be.
UNBOUNDED = 10_000


class Cell(NamedTuple):
    """A number in percent, or a difference in percentage points, and the bounds of its interval.

    NaN stands for a value that does not exist, and for bounds where there is nothing to resample.
    A cell that is ``signed`` is a difference: it is printed with its sign.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    signed: bool = False

    def text(self, decimals: int = 2) -> str:
        """Returns the value as a table shows it."""
        return _number(self.value, self.signed, decimals)

    def bounds(self, decimals: int = 2) -> list[str]:
        """Returns both bounds as a table shows them; nothing where there is no interval."""
        if math.isnan(self.low) or math.isnan(self.high):
            return []
        return [_number(end, self.signed, decimals) for end in (self.low, self.high)]


# A row of a table: its name, and its entries.
Row = tuple[str, Sequence[Cell | str | None]]


class Shown(NamedTuple):
    """An entry of a table as it is shown: its text, the bounds below it if it is a number, and
    whether it is the best."""

    text: str
    bounds: list[str] | None
    is_best: bool


@dataclass(frozen=True)
class Table:
    """A small table to be shown: its title, its caption, and its named columns and rows.

    Each row has a name and, for each column, a `Cell`, a text, or ``None`` for nothing. ``head``
    stands above the names. ``key`` names the table. ``best`` says of a column whether its "high" or
    "low" end is the better one, and ``short`` heads it where room is scarce. A line is drawn before
    the rows ``lines``. Only the first ``ranked`` rows can be the best; those below them were scored
    on something else. ``recipes`` are those of its rows, where these are of models.
    """

    key: str
    title: str
    caption: str
    columns: Sequence[str]
    rows: Sequence[Row]
    head: str = "Method"
    best: Mapping[str, str] = field(default_factory=dict)
    short: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[int, ...] = ()
    ranked: int | None = None
    recipes: Sequence[str] = ()

    def entries(self, column: str) -> list[Cell | str | None]:
        place = self.columns.index(column)
        return [entries[place] for _, entries in self.rows]

    def best_rows(self, column: str) -> set[int]:
        """Returns the rows whose number is to be marked; none where there is no choice."""
        entries = self.entries(column)
        # A difference below scores is no rival of theirs.
        are_signed = all(cell.signed for cell in entries if isinstance(cell, Cell))
        values = {
            n: cell.value
            for n, cell in enumerate(entries[: self.ranked])
            if isinstance(cell, Cell) and cell.signed == are_signed and not math.isnan(cell.value)
        }
        if column not in self.best or len(set(values.values())) < 2:
            return set()

        best = (max if self.best[column] == "high" else min)(values.values())
        return {n for n, value in values.items() if value == best}

    def shown(self, decimals: int = 2) -> Iterator[tuple[str, list[Shown]]]:
        """Yields the name of every row, and its entries as they are shown."""
        best = {column: self.best_rows(column) for column in self.columns}
        for n, (name, entries) in enumerate(self.rows):
            shown = [
                Shown(entry.text(decimals), entry.bounds(decimals), n in best[column])
                if isinstance(entry, Cell)
                else Shown(entry or "", None, False)
                for column, entry in zip(self.columns, entries)
            ]
            yield name, shown


def with_recipes(table: Table, recipes: Sequence[str]) -> Table:
    """Names the recipe of every row: in the title where all models share one, else in a column."""
    of_models = {recipe for recipe in recipes if recipe != NO_RECIPE}
    if len(of_models) < 2:
        shared = "".join(f"; recipe {recipe}" for recipe in of_models)
        return replace(table, title=table.title + shared, recipes=recipes)
    rows = [(name, [*row, recipe]) for (name, row), recipe in zip(table.rows, recipes)]
    return replace(table, columns=[*table.columns, "Recipe"], rows=rows, recipes=recipes)


def _number(value: float, signed: bool, decimals: int) -> str:
    if math.isnan(value):
        return NONE
    text = f"{value:{'+' if signed else ''}.{decimals}f}"
    # Nothing is gained or lost by a number that rounds to nothing.
    return f"{0:.{decimals}f}" if not text.strip("+-0.") else text


# ------------------------------------------------------------------------------------------- CSV


def csv_of(tables: Iterable[Table]) -> str:
    """Returns one line for each cell of all tables, with its number as it is, or its text."""
    lines = [
        (table.key, name, column, *numbers, recipe)
        for table in tables
        for (name, entries), recipe in zip_longest(table.rows, table.recipes)
        for column, entry in zip(table.columns, entries)
        for numbers in [entry[:3] if isinstance(entry, Cell) else (entry, None, None)]
    ]
    columns = ["table", "row", "column", "value", "low", "high", "recipe"]
    return pd.DataFrame(lines, columns=columns).to_csv(index=False, lineterminator="\n")


# ---------------------------------------------------------------------------------- the terminal


def print_table(table: Table, console: Console | None = None) -> None:
    """Prints a table with the interval of every number below it; * marks the best of a column.

    Where an interval is too wide, its two bounds stand below each other.
    """
    console = console or Console(width=WIDTH)
    drawn, room = _drawn(table, stacked=False), console.options.update_width(UNBOUNDED)
    if Measurement.get(console, room, drawn).maximum > console.width:
        drawn = _drawn(table, stacked=True)
    drawn.title = Text(table.title, style="bold")
    console.print(drawn)


def _drawn(table: Table, stacked: bool) -> RichTable:
    drawn = RichTable(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
    drawn.add_column(table.head, overflow="fold", max_width=NAME_WIDTH)
    for column in table.columns:
        drawn.add_column(table.short.get(column, column), justify="right", no_wrap=True)

    for n, (name, row) in enumerate(table.shown(decimals=1)):
        if n in table.lines:
            drawn.add_section()
        drawn.add_row(Text(name), *(_printed(cell, stacked) for cell in row))
    return drawn


def _printed(cell: Shown, stacked: bool) -> Text:
    if cell.bounds is None:
        return Text(cell.text)
    # A blank where others have a star keeps the points in line.
    value = (f"{cell.text}*", "bold") if cell.is_best else (f"{cell.text} ", "")
    below = cell.bounds if stacked or not cell.bounds else [f"[{', '.join(cell.bounds)}]"]
    return Text.assemble(value, *((f"\n{end} ", "dim") for end in below))
