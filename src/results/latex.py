"""A table to be shown as LaTeX sets it."""

import pandas as pd

from .render import NONE, Shown, Table

# More columns than these span both columns of a page in LaTeX.
WIDE = 7
LATEX = {
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''"},
    **{"Δ": r"$\Delta$", "✓": r"$\surd$", "✗": r"$\times$", "–": "--", "á": r"\'a"},
    # At the beginning of a row they would be arguments of the line break before it.
    **{"[": "{[}", "*": "{*}"},
}
# A plain LaTeX has no letters beyond this one, and stops at them.
LAST_LATIN = "\u017f"
# The table is made no wider than the page where the package graphicx can see to it.
BOXED = r"\centering\setlength{\tabcolsep}{3pt}\sbox0{"
FITTED = (
    r"\ifdim\wd0>\linewidth\ifcsname resizebox\endcsname\resizebox{\linewidth}{!}{\usebox0}"
    r"\else\usebox0\fi\else\usebox0\fi"
)


def latex_of(table: Table) -> str:
    """Returns a float with the table, its caption and the label ``tab:<key>``; the best is bold.

    Intervals stand small below their numbers. A document that inputs it needs only ``booktabs``;
    with ``graphicx`` a table that is too wide is made smaller.
    """
    is_wide = len(table.columns) > WIDE
    rows = []
    for n, (name, row) in enumerate(table.shown()):
        rule = r"\midrule" if n in table.lines else r"\addlinespace[2pt]" if n else ""
        rows.append([f"{rule} {latex(name)}".strip(), *map(_latex_value, row)])
        if any(cell.bounds for cell in row):
            rows.append(["", *map(_latex_bounds, row)])

    text = pd.DataFrame(rows, columns=list(map(latex, (table.head, *table.columns)))).to_latex(
        index=False,
        escape=False,
        column_format=f"l{'c' * len(table.columns)}",
        caption=rf"\textbf{{{latex(table.title)}.}} {latex(table.caption)}",
        label=f"tab:{table.key}",
        position="t",
    )
    size = r"\scriptsize" if is_wide else r"\small"
    text = text.replace(r"\begin{tabular}", rf"{size}{BOXED}\begin{{tabular}}")
    text = text.replace(r"\end{tabular}", rf"\end{{tabular}}}}{FITTED}")
    return text.replace("{table}", "{table*}") if is_wide else text


def latex(text: str) -> str:
    """Returns text that LaTeX sets as it is written, as far as it has the letters."""
    return "".join(LATEX.get(letter, letter if letter <= LAST_LATIN else "?") for letter in text)


def _latex_value(cell: Shown) -> str:
    text = latex(cell.text)
    # A hyphen would be set shorter than the plus that it stands below.
    text = text if cell.bounds is None or cell.text == NONE else text.replace("-", "$-$")
    return rf"\textbf{{{text}}}" if cell.is_best else text


def _latex_bounds(cell: Shown) -> str:
    bounds = ", ".join(cell.bounds or ()).replace("-", "$-$")
    return rf"{{\tiny [{bounds}]}}" if bounds else ""
