"""A table of a report: named columns of numbers with their intervals."""

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Cell:
    """A number in percent, or a difference in percentage points, and the bounds of its interval.

    NaN for a value that does not exist, and for bounds where there is nothing to resample.
    """

    value: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class Column:
    """``key`` heads the column in CSV and ``name`` everywhere else. ``signed`` numbers are printed
    with their sign; of ``best`` ones the highest or lowest of the table is marked."""

    key: str
    name: str
    signed: bool = False
    best: Literal["high", "low"] | None = None


@dataclass(frozen=True)
class ReportTable:
    """``key`` is the stem of its files. A row is a name and an entry for each column: a number, a
    text, or ``None`` for an empty one."""

    key: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell | str | None, ...]], ...]
