"""A table in every form: whole, with the best marked, and nothing that a form would swallow."""

import io
import math
import re

import pandas as pd
import pytest
from rich.console import Console

from src.results.latex import latex, latex_of
from src.results.render import Cell, Table, csv_of, print_table
from tests.report.typesetting import typeset

NASTY = 'a|b_c & 100 % of #1 {x} ~^ \\n $2 <"é"> *[z], Δ'
TABLE = Table(
    "some_table",
    "Title of 100 %, test_part",
    f"Caption with {NASTY}.",
    ["Att. Proj.", "mIoU", "Δ mIoU", "Rate"],
    [
        ("Baseline", ["✗", Cell(1 / 3, 0.1, 0.7), Cell(0.0, signed=True), Cell(80.0, 70, 95.5)]),
        (NASTY, ["✓", Cell(25.085, 20, 30), Cell(-1.5, -3.0, 0.001, True), Cell(7.0, 1, 9)]),
        ("+ other", ["✓", Cell(math.nan), None, Cell(10.0)]),
        ("Gain", ["", Cell(99.0, 98.0, 99.5, signed=True), None, None]),
    ],
    best={"mIoU": "high", "Δ mIoU": "high", "Rate": "low"},
    short={"Rate": "r."},
    lines=(3,),
)


def wide(columns, rows):
    """A table of the same numbers in every column."""
    names = [f"KAR-mIoU {n}" for n in range(columns)]
    cells = [(row, [Cell(88.8 + n / 100, 77.7, 99.9) for n in range(columns)]) for row in rows]
    best, short = (dict.fromkeys(names, word) for word in ("high", "free"))
    return Table("wide", "Wide", "All.", names, cells, best=best, short=short)


def test_what_rounds_to_nothing_has_no_sign():
    assert Cell(-0.004, signed=True).text() == Cell(-0.0049).text() == "0.00"
    assert Cell(0.006, signed=True).text() == "+0.01"
    assert Cell(math.nan).text() == "–"
    assert Cell(0.0, -0.001, 0.5, signed=True).bounds(1) == ["0.0", "+0.5"]
    assert Cell(1.0).bounds() == []


ONE, TWO, THREE = Cell(1.0), Cell(2.0), Cell(3.0)
NONE_OF_THEM = [ONE, Cell(math.nan), Cell(9.0, signed=True), None]


@pytest.mark.parametrize(
    ("cells", "end", "ranked", "best"),
    [
        ([ONE, THREE, TWO], "high", None, {1}),
        ([ONE, THREE, TWO], "low", None, {0}),
        ([ONE, THREE, THREE], "high", None, {1, 2}),
        (NONE_OF_THEM, "high", None, set()),
        ([Cell(0.0), Cell(0.0)], "high", None, set()),
        ([ONE, TWO], None, None, set()),
        ([Cell(1.0, signed=True), Cell(2.0, signed=True)], "high", None, {1}),
        ([ONE, TWO, THREE], "high", 2, {1}),  # the others were not scored alike
    ],
)
def test_the_best_is_of_scores_and_only_where_there_is_a_choice(cells, end, ranked, best):
    rows = [(str(n), [cell]) for n, cell in enumerate(cells)]
    table = Table("k", "t", "c", ["a"], rows, best={"a": end} if end else {}, ranked=ranked)
    assert table.best_rows("a") == best


def test_a_csv_has_every_cell_and_reads_back_equal():
    table = pd.read_csv(io.StringIO(csv_of([TABLE])), float_precision="round_trip")
    assert set(table["table"]) == {"some_table"}
    assert len(table) == 4 * 4
    for name, entries in TABLE.rows:
        for column, entry in zip(TABLE.columns, entries):
            (line,) = table[(table["row"] == name) & (table["column"] == column)].itertuples()
            if isinstance(entry, Cell):
                read = [float(number) for number in (line.value, line.low, line.high)]
                assert read == pytest.approx(list(entry[:3]), abs=0, nan_ok=True)
            else:
                assert (line.value if isinstance(line.value, str) else "") == (entry or "")


def test_specials_are_escaped_in_latex():
    assert latex("a_b & 5 % #1 {x}") == r"a\_b \& 5 \% \#1 \{x\}"
    assert latex("~^\\") == r"\textasciitilde{}\textasciicircum{}\textbackslash{}"
    assert latex("Δ ✓✗ Lovász –") == r"$\Delta$ $\surd$$\times$ Lov\'asz --"
    assert latex("[*] 日") == "{[}{*}] ?"


def test_latex_marks_the_best_and_sets_signs_and_intervals():
    text = latex_of(TABLE)
    assert text.startswith("\\begin{table}[t]")
    assert latex_of(wide(9, ["a"])).startswith("\\begin{table*}[t]")
    # Nothing is left bare where it would comment out or open something.
    assert not re.search(r"(?<!\\)[%#]", text)
    lines = text.split("\\toprule\n")[1].split("\\bottomrule")[0].splitlines()
    nasty = next(n for n, line in enumerate(lines) if r"] a\textbar" in line)
    assert r"\textbf{25.09}" in lines[nasty]
    assert "$-$1.50" in lines[nasty]
    assert r"{\tiny [20.00, 30.00]} & {\tiny [$-$3.00, 0.00]}" in lines[nasty + 1]
    (gain,) = (line for line in lines if line.startswith(r"\midrule Gain"))
    assert "+99.00" in gain
    assert r"\textbf{+99.00}" not in gain


@pytest.mark.slow
@pytest.mark.parametrize("packages", [("booktabs",), ("booktabs", "graphicx")])
def test_it_compiles_and_fits_the_page_where_graphicx_is_there(tmp_path, packages):
    both = f"{latex_of(TABLE)}\n{latex_of(wide(11, ['Row 0', 'Row 1']))}"
    assert ("Overfull" in typeset(tmp_path, both, packages)) == ("graphicx" not in packages)


def printed(table):
    console = Console(file=io.StringIO(), width=110)
    print_table(table, console)
    return console.file.getvalue()


def test_a_printed_table_shows_intervals_below_and_a_star_for_the_best():
    lines = printed(TABLE).splitlines()
    row = next(n for n, line in enumerate(lines) if "a|b_c" in line)
    assert re.search(r"✓\s+25\.1\*\s+-1\.5\s+7\.0\*", lines[row])
    assert re.search(r"\[20\.0, 30\.0\]\s+\[-3\.0, 0\.0\]\s+\[1\.0, 9\.0\]", lines[row + 1])
    assert "r." in printed(TABLE)


@pytest.mark.parametrize("columns", [5, 11])
def test_a_printed_table_keeps_to_110_columns_and_cuts_nothing(columns):
    names = ("+ Attitude-aware projection", "an_experiment_of_a_long_name_that_has_to_be_folded")
    text = printed(wide(columns, names))
    assert max(map(len, text.splitlines())) <= 110
    assert "…" not in text
    assert ("[77.7, 99.9]" in text) == (columns == 5)
    assert (["77.7"] * 11 in [line.split() for line in text.splitlines()]) == (columns == 11)
    assert text.count("99.9") == 2 * columns
