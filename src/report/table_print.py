"""A table of a report on the terminal."""

from collections.abc import Callable

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from .report_table import Cell, Column, ReportTable, bounds, number

UNBOUNDED = 10_000
"""Columns, to measure what a table would take."""
NAME_WIDTH = 30
"""Longer names are folded."""

Below = Callable[[Cell, Column], list[str]]


def print_table(table: ReportTable, console: Console) -> None:
    """Print a table with the interval of every number below it; * marks the best of a column.

    Where an interval is too wide its two bounds stand below each other.
    """
    drawn, room = _drawn(table, _side_by_side), console.options.update_width(UNBOUNDED)
    if Measurement.get(console, room, drawn).maximum > console.width:
        drawn = _drawn(table, _stacked)
    drawn.title = Text(f"{table.title} (%; below each number its interval)", style="bold")
    console.print(drawn)


def _drawn(table: ReportTable, below: Below) -> Table:
    drawn = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
    drawn.add_column(table.head, overflow="fold", max_width=NAME_WIDTH)
    for column in table.columns:
        drawn.add_column(column.short or column.name, justify="right", no_wrap=True)
    best = [table.best_rows(n) for n in range(len(table.columns))]
    for row, (name, entries) in enumerate(table.rows):
        if row in table.lines:
            drawn.add_section()
        cells = [
            _cell(entry, column, row in best[n], below)
            for n, (entry, column) in enumerate(zip(entries, table.columns))
        ]
        drawn.add_row(Text(name), *cells)
    return drawn


def _cell(entry: Cell | str | None, column: Column, is_best: bool, below: Below) -> Text:
    if not isinstance(entry, Cell):
        return Text(entry or "")
    value = number(entry, column, decimals=1)
    # A blank where others have a star keeps the points in line.
    lines = [(f"{value}*", "bold") if is_best else (f"{value} ", "")]
    if entry.has_bounds:
        lines += [(f"\n{end} ", "dim") for end in below(entry, column)]
    return Text.assemble(*lines)


def _side_by_side(cell: Cell, column: Column) -> list[str]:
    return [bounds(cell, column, decimals=1)]


def _stacked(cell: Cell, column: Column) -> list[str]:
    return bounds(cell, column, decimals=1).strip("[]").split(", ")
