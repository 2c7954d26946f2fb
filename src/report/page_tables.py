"""Tables of a report as HTML that a reader can sort."""

import math
from html import escape

from .report_table import NONE, Cell, Column, ReportTable, bounds, number

MINUS = "−"


def table_html(table: ReportTable) -> str:
    """A section with the table in a box of its own, in which a wide one scrolls."""
    key = escape(table.key)
    heads = [_head(Column("", table.head), is_text=True)]
    heads += [_head(column, _is_text(table, n)) for n, column in enumerate(table.columns)]
    return (
        f'<section class="table" id="table-{key}"><h3 id="title-{key}">{escape(table.title)}</h3>'
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="title-{key}">'
        f"<table><thead><tr>{''.join(heads)}</tr></thead><tbody>{_rows(table)}</tbody></table>"
        f'</div><p class="caption">{escape(table.caption)}</p></section>'
    )


def _is_text(table: ReportTable, column: int) -> bool:
    return any(isinstance(cells[column], str) for _, cells in table.rows)


def _head(column: Column, is_text: bool) -> str:
    """A column's head is a button that sorts by it: numbers best first, and the highest first where
    there is no best; texts by the alphabet."""
    first = "ascending" if is_text or column.best == "low" else "descending"
    name = escape(column.name)
    if column.short:
        name = f'<span class="long">{name}</span><span class="short">{escape(column.short)}</span>'
    kind = ' class="text"' if is_text else ""
    return (
        f'<th scope="col"{kind} aria-sort="none"><button type="button" data-first="{first}">'
        f"{name}</button></th>"
    )


def _rows(table: ReportTable) -> str:
    best = [table.best_rows(n) for n in range(len(table.columns))]
    rows = []
    for row, (name, cells) in enumerate(table.rows):
        entries = (
            _entry(cell, column, row in best[n], _is_text(table, n))
            for n, (cell, column) in enumerate(zip(cells, table.columns))
        )
        kind = ' class="line"' if row in table.lines else ""
        rows.append(f'<tr{kind}><th scope="row">{escape(name)}</th>{"".join(entries)}</tr>')
    return "".join(rows)


def _entry(cell: Cell | str | None, column: Column, is_best: bool, is_text: bool) -> str:
    """A data cell; one with a number keeps the whole of it to sort by."""
    if isinstance(cell, str):
        return f'<td class="text">{escape(cell)}</td>'
    if cell is None or not math.isfinite(cell.value):
        kind = "text empty" if is_text else "empty"
        return f'<td class="{kind}"><span aria-label="none">{NONE}</span></td>'
    value, interval = (_minus(say(cell, column)) for say in (number, bounds))
    shown = f'<b>{value}</b><span class="hidden"> best</span>' if is_best else value
    if interval:
        shown += f" <small>{interval}</small>"
    kind = ' class="best"' if is_best else ""
    # A difference below scores is not sorted among them.
    apart = " data-apart" if cell.signed and not column.signed else ""
    return f'<td{kind} data-value="{float(cell.value)!r}"{apart}>{shown}</td>'


def _minus(text: str) -> str:
    """With the sign of the typesetters, which is as wide as a plus."""
    return text.replace("-", MINUS)
