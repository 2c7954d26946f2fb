"""A table as HTML: what a cell says, what is marked, and what a reader sorts by."""

import re

from src.report.page_tables import table_html
from src.report.report_table import Cell, Column, ReportTable

NAN = float("nan")


def table(columns, rows, title="Ladder", caption="In percent.", **more):
    return table_html(ReportTable("ladder", title, caption, columns, rows, **more))


def cells(html):
    """The attributes and the text of every data cell."""
    return [
        (attributes.strip(), re.sub("<[^>]*>", "", content))
        for attributes, content in re.findall(r"<td([^>]*)>(.*?)</td>", html)
    ]


def test_a_cell_shows_its_value_and_interval_and_keeps_the_value_whole():
    html = table((Column("miou", "mIoU"),), (("a", (Cell(14.26, 12.1, 16.04),)),))
    assert cells(html) == [('data-value="14.26"', "14.26 [12.10, 16.04]")]


def test_there_is_no_interval_where_there_was_nothing_to_resample():
    html = table((Column("miou", "mIoU"),), (("a", (Cell(14.2),)),))
    assert cells(html) == [('data-value="14.2"', "14.20")]


def test_signed_numbers_carry_their_sign_and_zero_has_none():
    rows = tuple((str(v), (Cell(v, v - 1, v + 1),)) for v in (1.0, -0.25, 0.001))
    html = table((Column("d", "difference", signed=True),), rows)
    assert [text for _, text in cells(html)] == [
        "+1.00 [0.00, +2.00]",
        "−0.25 [−1.25, +0.75]",
        "0.00 [−1.00, +1.00]",
    ]


def test_a_difference_below_scores_has_its_sign_and_is_kept_apart():
    html = table(
        (Column("a", "a", best="high"),), (("x", (Cell(1.0),)), ("gain", (Cell(2.0, signed=True),)))
    )
    assert cells(html)[1] == ('data-value="2.0" data-apart', "+2.00")


def test_the_best_is_marked_and_said():
    columns = (Column("a", "a", best="high"), Column("b", "b", best="low"), Column("c", "c"))
    rows = (
        ("x", (Cell(5.1), Cell(3.0), Cell(9.0))),
        ("y", (Cell(5.0), Cell(2.0), Cell(1.0))),
        ("z", (Cell(4.9), Cell(NAN), Cell(5.0))),
    )
    found = cells(table(columns, rows))
    assert ["best" in attributes for attributes, _ in found] == [
        *(True, False, False),
        *(False, True, False),
        *(False, False, False),
    ]
    assert found[0][1] == "5.10 best"


def test_lines_are_before_the_rows_that_the_table_says():
    rows = tuple((name, (Cell(1.0),)) for name in "abc")
    html = table_html(ReportTable("t", "T", "", (Column("a", "a"),), rows, lines=(2,)))
    assert re.findall(r'<tr class="line"><th scope="row">(\w)', html) == ["c"]


def test_empty_cells_and_texts_are_told_from_numbers():
    columns = (Column("a", "a"), Column("b", "b"), Column("c", "c"))
    html = table(columns, (("x", (None, Cell(NAN), "level <i>")),))
    assert cells(html) == [
        ('class="empty"', "–"),
        ('class="empty"', "–"),
        ('class="text"', "level &lt;i&gt;"),
    ]


def test_names_are_escaped_everywhere():
    wicked = "<script>\"'&"
    html = table((Column("a", wicked),), ((wicked, (Cell(1.0),)),), title=wicked, caption=wicked)
    assert "<script>" not in html
    assert html.count("&lt;script&gt;") == 4


def test_each_head_is_a_button_that_begins_with_the_best():
    columns = (Column("a", "a", best="high"), Column("b", "b", best="low"), Column("c", "c"))
    html = table(columns, (), head="Experiment")
    assert ">Experiment</button>" in html
    assert html.count('aria-sort="none"') == 4
    assert re.findall(r'data-first="(\w+)"', html) == [
        "ascending", "descending", "ascending", "descending",
    ]  # fmt: skip
