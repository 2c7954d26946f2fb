"""A table in LaTeX, as the paper sets its own: with booktabs, and nothing else beside it."""

import math

from .report_table import Cell, Column, ReportTable, bounds, number

SPECIAL = {
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''"},
    **{"Δ": r"$\Delta$", "✓": r"$\surd$", "✗": r"$\times$", "–": "--", "á": r"\'a"},
    # At the beginning of a row they would be arguments of the line break before it.
    **{"[": "{[}", "*": "{*}"},
}
LAST_LATIN = "\u017f"
"""Beyond it a plain LaTeX has no letters, and stops."""
FITTED = (
    r"\ifdim\wd0>\linewidth\ifcsname resizebox\endcsname\resizebox{\linewidth}{!}{\usebox0}"
    r"\else\usebox0\fi\else\usebox0\fi"
)
"""The table, no wider than the page where ``graphicx`` can see to it."""
WIDE = 7
"""More columns than these span both columns of the page."""


def latex_of(table: ReportTable) -> str:
    """A float with the table, its caption and the label ``tab:<key>``; the best is bold.

    Intervals stand small below their numbers. A document that inputs it needs only ``booktabs``;
    with ``graphicx`` a table that is too wide is made smaller.
    """
    wide = len(table.columns) > WIDE
    kind, size = ("table*", r"\scriptsize") if wide else ("table", r"\small")
    head = [escaped(text) for text in (table.head, *(column.name for column in table.columns))]
    rows = [_row(table, n) for n in range(len(table.rows))]
    for n in sorted(table.lines, reverse=True):
        rows.insert(n, r"\midrule")
    lines = (
        rf"\begin{{{kind}}}[t]",
        r"\centering",
        size,
        r"\setlength{\tabcolsep}{3pt}",
        rf"\caption{{\textbf{{{escaped(table.title)}.}} {escaped(table.caption)}}}",
        rf"\label{{tab:{table.key}}}",
        rf"\sbox0{{\begin{{tabular}}{{l{'c' * len(table.columns)}}}",
        r"\toprule",
        " & ".join(head) + r" \\",
        r"\midrule",
        *rows,
        r"\bottomrule",
        r"\end{tabular}}",
        FITTED,
        rf"\end{{{kind}}}",
    )
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Text that LaTeX sets as it is written, as far as it has the letters."""
    return "".join(
        SPECIAL.get(character, character if character <= LAST_LATIN else "?") for character in text
    )


def _row(table: ReportTable, row: int) -> str:
    """One line of numbers, and where there is any interval a small one of them below."""
    name, entries = table.rows[row]
    values, below = [], []
    for n, (entry, column) in enumerate(zip(entries, table.columns)):
        values.append(_value(entry, column, row in table.best_rows(n)))
        interval = bounds(entry, column) if isinstance(entry, Cell) else ""
        below.append(_minus(rf"{{\tiny {interval}}}") if interval else "")
    lines = [" & ".join([escaped(name), *values]) + r" \\"]
    if any(below):
        lines.append(" & ".join(["", *below]) + r" \\[2pt]")
    return "\n".join(lines)


def _value(entry: Cell | str | None, column: Column, is_best: bool) -> str:
    if not isinstance(entry, Cell):
        return escaped(entry or "")
    if math.isnan(entry.value):
        return escaped(number(entry, column))
    text = _minus(number(entry, column))
    return rf"\textbf{{{text}}}" if is_best else text


def _minus(text: str) -> str:
    """A number's hyphen as the sign that it is."""
    return text.replace("-", "$-$")
