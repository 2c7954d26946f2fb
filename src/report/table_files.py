"""The files of a table: CSV to compute with, Markdown and LaTeX to read."""

import csv
import io
import math
from pathlib import Path

from ..atomic import replacing
from .latex import latex_of
from .report_table import Cell, Column, ReportTable, bounds, number

BOUNDS = ("low", "high")
ENDINGS = (".csv", ".md", ".tex")


def write_files(table: ReportTable, folder: Path) -> list[Path]:
    """Write ``<key>.csv``, ``<key>.md`` and ``<key>.tex``; each is replaced as a whole.

    Raises `UserError` where one cannot be written.
    """
    texts = (csv_of(table), markdown_of(table), latex_of(table))
    paths = [folder / f"{table.key}{ending}" for ending in ENDINGS]
    for path, text in zip(paths, texts):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    return paths


def csv_of(table: ReportTable) -> str:
    """One line a row: its name, and of every number the value and its bounds (``<key>_low``,
    ``<key>_high``), as they are. What does not exist is empty."""
    numbers = [_is_number(table, n) for n in range(len(table.columns))]
    header = ["row"]
    for column, is_number in zip(table.columns, numbers):
        header += [column.key, *(f"{column.key}_{end}" for end in BOUNDS * is_number)]
    lines = [header]
    for name, entries in table.rows:
        line = [name]
        for entry, is_number in zip(entries, numbers):
            line += _fields(entry) if is_number else [entry or ""]
        lines.append(line)
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def markdown_of(table: ReportTable) -> str:
    """A table with its title and caption; the best of a column is bold."""
    names = [escaped(text) for text in (table.head, *(column.name for column in table.columns))]
    lines = [names, [":--", *["--:"] * len(table.columns)]]
    for row, (name, entries) in enumerate(table.rows):
        cells = [
            _markdown(entry, column, row in table.best_rows(n))
            for n, (entry, column) in enumerate(zip(entries, table.columns))
        ]
        lines.append([escaped(name), *cells])
    rows = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    return f"**{escaped(table.title)}.** {escaped(table.caption)}\n\n{rows}"


def escaped(text: str) -> str:
    """Text that Markdown shows as it is written, also in a cell."""
    return "".join(f"\\{letter}" if letter in "\\|_*`<[" else letter for letter in text)


def _is_number(table: ReportTable, n: int) -> bool:
    """Whether a column holds numbers; one that holds nothing does."""
    return not any(isinstance(entries[n], str) for _, entries in table.rows)


def _fields(entry: Cell | None) -> list[str]:
    values = (math.nan,) * 3 if entry is None else (entry.value, entry.low, entry.high)
    return ["" if math.isnan(value) else repr(value) for value in values]


def _markdown(entry: Cell | str | None, column: Column, is_best: bool) -> str:
    if not isinstance(entry, Cell):
        return escaped(entry or "")
    value = number(entry, column)
    return f"{f'**{value}**' if is_best else value} {bounds(entry, column)}".strip()
