"""Tables of a report as HTML that a reader can sort."""

import math
from html import escape

from .report_table import Cell, Column, ReportTable

MINUS = "−"


def table_html(table: ReportTable) -> str:
    """A section with the table in a box of its own, in which a wide one scrolls."""
    heads = [_head("name", "ascending"), *(_head(c.name, _first(c)) for c in table.columns)]
    best = [_best_rows(table, n) for n in range(len(table.columns))]
    rows = [
        f'<tr><th scope="row">{escape(name)}</th>'
        + "".join(
            _entry(cell, column, row in best[n])
            for n, (cell, column) in enumerate(zip(cells, table.columns))
        )
        + "</tr>"
        for row, (name, cells) in enumerate(table.rows)
    ]
    key = escape(table.key)
    return (
        f'<section class="table" id="table-{key}"><h3 id="title-{key}">{escape(table.title)}</h3>'
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="title-{key}">'
        f"<table><thead><tr>{''.join(heads)}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
        f'</div><p class="caption">{escape(table.caption)}</p></section>'
    )


def _head(name: str, first: str) -> str:
    """A column's head is the button that sorts by it; ``first`` is the direction it begins with."""
    return (
        f'<th scope="col" aria-sort="none"><button type="button" data-first="{first}">'
        f"{escape(name)}</button></th>"
    )


def _first(column: Column) -> str:
    """Best first; where there is no best, the highest first."""
    return "ascending" if column.best == "low" else "descending"


def _best_rows(table: ReportTable, column: int) -> set[int]:
    """The rows whose number is, as printed, the best of a column that has several."""
    best = table.columns[column].best
    cells = {row: cells[column] for row, (_, cells) in enumerate(table.rows)}
    values = {
        row: round(cell.value, 1)
        for row, cell in cells.items()
        if isinstance(cell, Cell) and math.isfinite(cell.value)
    }
    if best is None or len(values) < 2:
        return set()
    wanted = max(values.values()) if best == "high" else min(values.values())
    return {row for row, value in values.items() if value == wanted}


def _entry(cell: Cell | str | None, column: Column, is_best: bool) -> str:
    if isinstance(cell, str):
        return f'<td class="text" data-text="{escape(cell)}">{escape(cell)}</td>'
    if cell is None or not math.isfinite(cell.value):
        return '<td class="empty"><span aria-label="none">–</span></td>'
    value = _number(cell.value, column.signed)
    shown = f"<b>{value}</b>" if is_best else f"<span>{value}</span>"
    if is_best:
        shown += '<span class="hidden"> best</span>'
    if math.isfinite(cell.low) and math.isfinite(cell.high):
        low, high = (_number(bound, column.signed) for bound in (cell.low, cell.high))
        shown += f" <small>[{low}, {high}]</small>"
    kind = ' class="best"' if is_best else ""
    return f'<td{kind} data-value="{cell.value!r}">{shown}</td>'


def _number(value: float, signed: bool) -> str:
    """One decimal; a signed number with its sign, and zero without."""
    text = f"{abs(value):.1f}"
    if float(text) == 0:
        return text
    return f"{MINUS if value < 0 else '+' if signed else ''}{text}"
