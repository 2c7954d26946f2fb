"""Learning curves of several runs: which points, which numbers along the axes, which words."""

import html
import json
import re

import pytest

from src.report.curve_plot import (
    BOTTOM,
    COLORS,
    HEIGHT,
    LEFT,
    TOP,
    Curve,
    CurvePlot,
    mean_of,
    plot_html,
    ticks_of,
)
from src.report.page import WEB

SEEDS = (
    Curve("skyocc", (1, 2, 3), (2.0, 4.0, 6.0)),
    Curve("skyocc", (1, 2), (4.0, 5.0)),
    Curve("baseline", (2, 1), (1.0, 3.0)),
)


def stops_of(page):
    return json.loads(html.unescape(re.search(r'data-stops="([^"]*)"', page)[1]))


def test_points_are_in_order_and_finite():
    curve = Curve("a", (2, 1, 3, 4), (5.0, 6.0, float("nan"), float("inf")))
    assert curve.points() == [(1, 6.0), (2, 5.0)]


def test_the_mean_ends_where_the_first_seed_ends():
    assert mean_of([curve.points() for curve in SEEDS[:2]]) == [(1, 3.0), (2, 4.5)]


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 10.0, [0, 2, 4, 6, 8, 10]),
        (0.7, 3.1, [0.5, 1, 1.5, 2, 2.5, 3, 3.5]),
        (5.0, 5.0, [4.4, 4.6, 4.8, 5, 5.2, 5.4, 5.6]),
        (1e-4, 4e-4, [1e-4, 2e-4, 3e-4, 4e-4]),
    ],
)
def test_the_numbers_along_an_axis_are_round_and_hold_all(low, high, expected):
    assert ticks_of(low, high, 5) == pytest.approx(expected)


def test_epochs_are_whole_numbers():
    assert ticks_of(0, 3, 8, whole=True) == [0, 1, 2, 3]
    assert ticks_of(0, 24, 8, whole=True) == [0, 5, 10, 15, 20, 25]


def test_one_colour_a_run_a_thin_line_a_seed_and_a_thick_one_for_their_mean():
    page = plot_html(CurvePlot("Validation KAR-mIoU", "%", SEEDS))
    assert page.count('class="mean"') == 2
    assert page.count('class="seed"') == 2
    assert page.count("color-0") == page.count("color-1") == 2, "its curves and its legend"


def test_no_two_of_many_runs_look_alike():
    runs = [Curve(f"run{n:02d}", (1, 2), (1.0, float(n))) for n in range(2 * COLORS + 3)]
    page = plot_html(CurvePlot("Loss", "", tuple(runs)))
    drawn, told = (re.findall(p, page) for p in (r'<g class="run ([^"]*)"', r'<li class="([^"]*)"'))
    assert drawn == told
    assert len(set(drawn)) == len(runs)
    style = (WEB / "plots.css").read_text()
    assert all(f".{name} {{" in style for name in {each for pair in drawn for each in pair.split()})


def test_a_higher_value_is_higher_and_a_later_epoch_further_right():
    page = plot_html(CurvePlot("Loss", "", SEEDS[2:]))
    points = re.search(r'class="mean" points="([^"]*)"', page)[1].split()
    (x1, y1), (x2, y2) = (map(float, point.split(",")) for point in points)
    assert LEFT < x1 < x2
    assert TOP <= y1 < y2 <= HEIGHT - BOTTOM, "3.0, then 1.0"


def test_each_epoch_has_words_for_each_run():
    stops = stops_of(plot_html(CurvePlot("Validation KAR-mIoU", "%", SEEDS)))
    assert [stop["epoch"] for stop in stops] == ["1", "2", "3"]
    assert [stop["texts"] for stop in stops] == [
        ["3.0 % (2.0 to 4.0, 2 seeds)", "3.0 %"],
        ["4.5 % (4.0 to 5.0, 2 seeds)", "1.0 %"],
        ["6.0 % (6.0 to 6.0, 1 seed)", "–"],
    ]


def test_a_loss_has_three_digits():
    curve = Curve("a", (1, 2, 3), (1.2, 0.0345, 123.4))
    stops = stops_of(plot_html(CurvePlot("Loss", "", (curve,))))
    assert [stop["texts"][0] for stop in stops] == ["1.20", "0.0345", "123"]


def test_a_plot_of_nothing_says_so_and_one_point_is_a_plot():
    assert "Nothing was logged" in plot_html(CurvePlot("Loss", "", (Curve("a", (), ()),)))
    assert "<circle" in plot_html(CurvePlot("Loss", "", (Curve("a", (1,), (2.0,)),)))


def test_names_are_escaped():
    page = plot_html(CurvePlot("<b>", "<i>", (Curve('"><script>', (1,), (2.0,)),)))
    assert "<script>" not in page
    assert "<i>" not in page
    assert page.count("<b>") == page.count("</b>") == 2, "the epoch, and the value"
