"""A table of a report: named columns of numbers with their intervals."""

import math
from dataclasses import dataclass
from typing import Literal

NONE = "–"
"""A score that does not exist."""


@dataclass(frozen=True)
class Cell:
    """A number in percent, or a difference in percentage points, and the bounds of its interval.

    NaN for a value that does not exist, and for bounds where there is nothing to resample. A cell
    that is ``signed`` is a difference: printed with its sign, and never the best among scores.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    signed: bool = False

    @property
    def has_bounds(self) -> bool:
        return not (math.isnan(self.low) or math.isnan(self.high))


@dataclass(frozen=True)
class Column:
    """``key`` heads the column in CSV and ``name`` everywhere else. ``signed`` numbers are printed
    with their sign; of ``best`` ones the highest or lowest of the table is marked. ``short`` heads
    it where room is scarce."""

    key: str
    name: str
    signed: bool = False
    best: Literal["high", "low"] | None = None
    short: str = ""


@dataclass(frozen=True)
class ReportTable:
    """``key`` is the stem of its files. A row is a name and an entry for each column: a number, a
    text, or ``None`` for an empty one. ``head`` heads the names, and ``lines`` are the rows before
    which a line is drawn. The best is sought among the first ``ranked`` rows; those below them, if
    there are any, were scored on something else."""

    key: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell | str | None, ...]], ...]
    head: str = "Method"
    lines: tuple[int, ...] = ()
    ranked: int | None = None

    def best_rows(self, column: int) -> set[int]:
        """The rows whose number is to be marked in a column; none where there is no choice."""
        marked = self.columns[column]
        entries = [entries[column] for _, entries in self.rows[: self.ranked]]
        values = {
            n: entry.value
            for n, entry in enumerate(entries)
            # A difference below scores is no rival of theirs.
            if isinstance(entry, Cell) and entry.signed == marked.signed
        }
        values = {n: value for n, value in values.items() if not math.isnan(value)}
        if marked.best is None or len(set(values.values())) < 2:
            return set()
        best = max(values.values()) if marked.best == "high" else min(values.values())
        return {n for n, value in values.items() if value == best}


def number(cell: Cell, column: Column, decimals: int = 2) -> str:
    """The value of a cell as a table shows it."""
    if math.isnan(cell.value):
        return NONE
    sign = "+" if column.signed or cell.signed else ""
    text = f"{cell.value:{sign}.{decimals}f}"
    # Nothing is gained or lost by what rounds to nothing.
    return f"{0:.{decimals}f}" if not text.strip("+-0.") else text


def bounds(cell: Cell, column: Column, decimals: int = 2) -> str:
    """The interval of a cell as a table shows it; empty without one."""
    if not cell.has_bounds:
        return ""
    ends = (
        number(Cell(end, signed=cell.signed), column, decimals) for end in (cell.low, cell.high)
    )
    return f"[{', '.join(ends)}]"
