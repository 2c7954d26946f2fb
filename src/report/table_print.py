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


def print_table(table: ReportTable, console: Console) -> None:
    """Print a table with the interval of every number below it; * marks the best of a column.

    Where bounds have no room there is half the interval's width instead.
    """
    drawn, note = _drawn(table, _bounds), "below each: its interval"
    if (
        Measurement.get(console, console.options.update_width(UNBOUNDED), drawn).maximum
        > console.width
    ):
        drawn, note = _drawn(table, _half), "below each: half the width of its interval"
    drawn.title = Text(f"{table.title} (%; {note})", style="bold")
    console.print(drawn)


def _drawn(table: ReportTable, below: Callable[[Cell, Column], str]) -> Table:
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


def _cell(
    entry: Cell | str | None, column: Column, is_best: bool, below: Callable[[Cell, Column], str]
) -> Text:
    if not isinstance(entry, Cell):
        return Text(entry or "")
    value = number(entry, column, decimals=1)
    # A blank where others have a star keeps the points in line.
    top = (f"{value}*", "bold") if is_best else (f"{value} ", "")
    return (
        Text.assemble(top, "\n", (f"{below(entry, column)} ", "dim"))
        if entry.has_bounds
        else (Text.assemble(top))
    )


def _bounds(cell: Cell, column: Column) -> str:
    return bounds(cell, column, decimals=1)


def _half(cell: Cell, column: Column) -> str:
    return f"±{(cell.high - cell.low) / 2:.1f}"
