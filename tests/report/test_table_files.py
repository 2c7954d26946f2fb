"""Tables as files: read back equal, whole, and with nothing that the format would swallow."""

import io
import math
import re

import pandas as pd
import pytest
from rich.console import Console

from src.report.latex import escaped, latex_of
from src.report.report_table import Cell, Column, ReportTable, bounds, number
from src.report.table_files import csv_of, markdown_of, write_files
from src.report.table_print import print_table
from tests.report.typesetting import typeset

NASTY = 'a|b_c & 100 % of #1 {x} ~^ \\n $2 <"é"> *[z], Δ'
TABLE = ReportTable(
    "some_table",
    "Title of 100 %, test_part",
    f"Caption with {NASTY}.",
    (
        Column("mark", "Att. Proj."),
        Column("miou", "mIoU", best="high"),
        Column("delta_miou", "Δ mIoU", signed=True, best="high"),
        Column("rate", "Rate", best="low", short="r."),
    ),
    (
        ("Baseline", ("✗", Cell(1 / 3, 0.1, 0.7), Cell(0.0, signed=True), Cell(80.0, 70.0, 95.5))),
        (
            NASTY,
            ("✓", Cell(25.085, 20.0, 30.0), Cell(-1.5, -3.0, 0.001, True), Cell(7.0, 1.0, 9.0)),
        ),
        ("+ other", ("✓", Cell(math.nan), None, Cell(10.0))),
        ("Gain", ("", Cell(99.0, 98.0, 99.5, signed=True), None, None)),
    ),
    lines=(3,),
)


# ------------------------------------------------------------------------------------------ CSV


def read(text):
    return pd.read_csv(io.StringIO(text), index_col="row", float_precision="round_trip")


def test_a_csv_reads_back_equal():
    table = read(csv_of(TABLE))
    assert list(table.columns) == [
        *("mark", "miou", "miou_low", "miou_high"),
        *("delta_miou", "delta_miou_low", "delta_miou_high", "rate", "rate_low", "rate_high"),
    ]
    assert list(table.index) == [name for name, _ in TABLE.rows]
    for name, entries in TABLE.rows:
        for column, entry in zip(TABLE.columns[1:], entries[1:]):
            expected = entry or Cell(math.nan)
            for key, value in zip(
                (column.key, f"{column.key}_low", f"{column.key}_high"),
                (expected.value, expected.low, expected.high),
            ):
                found = table.loc[name, key]
                assert found == value or (math.isnan(found) and math.isnan(value)), (name, key)
    assert table["mark"].tolist()[:3] == ["✗", "✓", "✓"]


def test_numbers_of_a_csv_are_numbers():
    table = read(csv_of(TABLE))
    assert (table.dtypes.iloc[1:] == "float64").all()


# ------------------------------------------------------------------------------------- Markdown


def cells(line):
    """Of a row: bars that are escaped end none."""
    return re.split(r"(?<!\\)\|", line)[1:-1]


def test_every_row_of_markdown_has_every_column():
    lines = [line for line in markdown_of(TABLE).splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(TABLE.rows)
    assert {len(cells(line)) for line in lines} == {1 + len(TABLE.columns)}


def test_markdown_shows_the_interval_and_marks_the_best():
    lines = markdown_of(TABLE).splitlines()
    baseline, nasty, other, gain = (cells(line) for line in lines[-4:])
    assert [cell.strip() for cell in baseline] == [
        *("Baseline", "✗", "0.33 [0.10, 0.70]", "**0.00**", "80.00 [70.00, 95.50]"),
    ]
    assert nasty[2].strip() == "**25.09** [20.00, 30.00]"
    assert nasty[3].strip() == "-1.50 [-3.00, 0.00]"
    assert nasty[4].strip() == "**7.00** [1.00, 9.00]"
    assert [cell.strip() for cell in other[2:]] == ["–", "", "10.00"]
    assert gain[2].strip() == "+99.00 [+98.00, +99.50]"


# ---------------------------------------------------------------------------------------- LaTeX


def body(text):
    """The lines between the rules."""
    assert text.count("\\toprule") == text.count("\\bottomrule") == 1
    return text.split("\\toprule\n")[1].split("\\bottomrule")[0].splitlines()


def test_environments_and_braces_are_balanced():
    text = latex_of(TABLE)
    begun = re.findall(r"\\begin\{([a-z*]+)\}", text)
    assert re.findall(r"\\end\{([a-z*]+)\}", text) == begun[::-1]
    assert begun == ["table", "tabular"]
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0


def test_every_line_has_every_column_and_ends():
    text = latex_of(TABLE)
    lines = [line for line in body(text) if line != "\\midrule"]
    assert {len(re.findall(r"(?<!\\)&", line)) for line in lines} == {len(TABLE.columns)}
    assert all(re.search(r"\\\\(\[2pt\])?$", line) for line in lines)
    assert re.search(r"\\begin\{tabular\}\{lcccc\}", text)


def test_specials_are_escaped():
    assert escaped("a_b & 5 % #1 {x}") == r"a\_b \& 5 \% \#1 \{x\}"
    assert escaped("~^\\") == r"\textasciitilde{}\textasciicircum{}\textbackslash{}"
    assert escaped("Δ ✓✗ Lovász –") == r"$\Delta$ $\surd$$\times$ Lov\'asz --"
    assert escaped("[*] 日") == "{[}{*}] ?"
    # Nothing of them is left bare, where it would comment out or open something.
    assert not re.search(r"(?<!\\)[%#]", latex_of(TABLE))


def test_latex_marks_the_best_and_sets_signs_and_intervals():
    lines = body(latex_of(TABLE))
    nasty = next(n for n, line in enumerate(lines) if line.startswith("a\\textbar"))
    assert r"\textbf{25.09}" in lines[nasty]
    assert "$-$1.50" in lines[nasty]
    assert r"{\tiny [20.00, 30.00]} & {\tiny [$-$3.00, 0.00]}" in lines[nasty + 1]
    gain = next(n for n, line in enumerate(lines) if line.startswith("Gain"))
    assert lines[gain - 1] == "\\midrule"
    assert "+99.00" in lines[gain]
    assert r"\textbf{+99.00}" not in lines[gain]


def test_a_wide_table_spans_the_page():
    wide = ReportTable("w", "t", "c", tuple(Column(f"k{n}", f"{n}") for n in range(9)), ())
    assert latex_of(wide).startswith("\\begin{table*}[t]")


@pytest.mark.slow
@pytest.mark.parametrize("packages", [("booktabs",), ("booktabs", "graphicx")])
def test_it_compiles_and_fits_the_page_where_graphicx_is_there(tmp_path, packages):
    columns = tuple(Column(f"k{n}", "KAR-mIoU", best="high") for n in range(11))
    rows = tuple((f"Row {n}", (Cell(88.8 + n, 77.7, 99.9),) * 11) for n in range(3))
    wide = ReportTable("wide", "Wide", "Wider than the page.", columns, rows)
    said = typeset(tmp_path, f"{latex_of(TABLE)}\n{latex_of(wide)}", packages)
    assert ("Overfull" in said) == ("graphicx" not in packages)


# ----------------------------------------------------------------------------- what they share


def test_a_table_leaves_three_files(tmp_path):
    paths = write_files(TABLE, tmp_path / "new")
    names = ["some_table.csv", "some_table.md", "some_table.tex"]
    assert [path.name for path in paths] == sorted(
        path.name for path in (tmp_path / "new").iterdir()
    )
    assert [path.name for path in paths] == names
    assert paths[0].read_text() == csv_of(TABLE)


def test_what_rounds_to_nothing_has_no_sign():
    signed, plain = Column("a", "a", signed=True), Column("a", "a")
    assert number(Cell(-0.004), signed) == "0.00"
    assert number(Cell(-0.0049), plain) == "0.00"
    assert number(Cell(0.006), signed) == "+0.01"
    assert number(Cell(10.0), signed) == "+10.00"
    assert bounds(Cell(0.0, -0.001, 0.5), signed, 1) == "[0.0, +0.5]"
    assert bounds(Cell(1.0), plain) == ""


def test_the_best_is_of_scores_and_only_where_there_is_a_choice():
    def best(values, end="high", signed=False):
        rows = tuple((str(n), (value,)) for n, value in enumerate(values))
        column = Column("a", "a", best=end, signed=signed)
        return ReportTable("k", "t", "c", (column,), rows).best_rows(0)

    assert best([Cell(1.0), Cell(3.0), Cell(2.0)]) == {1}
    assert best([Cell(1.0), Cell(3.0), Cell(2.0)], "low") == {0}
    assert best([Cell(1.0), Cell(3.0), Cell(3.0)]) == {1, 2}
    assert best([Cell(1.0), Cell(math.nan), Cell(9.0, signed=True), None]) == set()
    assert best([Cell(0.0), Cell(0.0)]) == set()
    assert best([Cell(1.0), Cell(2.0)], end=None) == set()
    assert best([Cell(1.0, signed=True), Cell(2.0, signed=True)], signed=True) == {1}


# --------------------------------------------------------------------------------- the terminal


def printed(table, width=110):
    console = Console(file=io.StringIO(), width=width)
    print_table(table, console)
    return console.file.getvalue()


def test_a_printed_table_shows_intervals_below_and_a_star_for_the_best():
    text = printed(TABLE)
    lines = text.splitlines()
    row = next(n for n, line in enumerate(lines) if "a|b_c" in line)
    assert re.search(r"✓\s+25\.1\*\s+-1\.5\s+7\.0\*", lines[row])
    assert re.search(r"\[20\.0, 30\.0\]\s+\[-3\.0, 0\.0\]\s+\[1\.0, 9\.0\]", lines[row + 1])
    assert "r." in text


@pytest.mark.parametrize("columns", [5, 11])
def test_a_printed_table_keeps_to_110_columns_and_cuts_nothing(columns):
    keys = tuple(Column(f"k{n}", "Free Space", best="high", short="free") for n in range(columns))
    row = tuple(Cell(88.8 + n / 100, 77.7, 99.9) for n in range(columns))
    names = ("+ Attitude-aware projection", "an_experiment_of_a_long_name_that_has_to_be_folded")
    text = printed(ReportTable("k", "t", "c", keys, tuple((name, row) for name in names)))
    assert max(map(len, text.splitlines())) <= 110
    assert "…" not in text
    assert ("[77.7, 99.9]" in text) == (columns == 5)
    lines = [line.split() for line in text.splitlines()]
    assert (["77.7"] * 11 in lines) == (columns == 11)
    assert text.count("99.9") == 2 * columns
