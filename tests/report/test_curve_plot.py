"""Learning curves of several runs: which points, which means, which texts."""

import json

import pytest

from src.report.curve_plot import COLORS, Curve, CurvePlot

SEEDS = (
    Curve("skyocc", (1, 2, 3), (2.0, 4.0, 6.0)),
    Curve("skyocc", (1, 2), (4.0, 5.0)),
    Curve("baseline", (2, 1), (1.0, 3.0)),
)
PLOT = CurvePlot("Validation KAR-mIoU", "%", SEEDS)


def drawn(figure, thick):
    """Name and points of the lines of one kind: means are thick, seeds are thin."""
    lines = [line for line in figure.data if (line.line.width > 2) == thick]
    return [(line.name, list(zip(line.x, line.y))) for line in lines]


def test_points_are_finite():
    values = (5.0, 6.0, float("nan"), float("inf"))
    points = CurvePlot("Loss", "", (Curve("a", (2, 1, 3, 4), values),)).points()
    assert points[["epoch", "value"]].to_numpy().tolist() == [[2, 5.0], [1, 6.0]]


def test_a_thin_line_a_seed_and_a_thick_one_for_their_mean_which_ends_with_the_first_seed():
    figure = PLOT.figure()
    assert drawn(figure, thick=True) == [
        ("skyocc", [(1, 3.0), (2, 4.5)]),
        ("baseline", [(1, 3.0), (2, 1.0)]),
    ]
    assert drawn(figure, thick=False) == [
        ("skyocc", [(1, 2.0), (2, 4.0), (3, 6.0)]),
        ("skyocc", [(1, 4.0), (2, 5.0)]),
        ("baseline", [(1, 3.0), (2, 1.0)]),
    ]


def test_a_run_has_one_color_and_one_place_in_the_legend():
    figure = PLOT.figure()
    colors = {(line.name, line.line.color) for line in figure.data}
    assert colors == {("skyocc", COLORS[0]), ("baseline", COLORS[1])}
    assert [line.name for line in figure.data if line.showlegend] == ["skyocc", "baseline"]


def test_no_two_of_many_runs_look_alike():
    runs = [Curve(f"run{n:02d}", (1, 2), (1.0, float(n))) for n in range(2 * len(COLORS) + 3)]
    figure = CurvePlot("Loss", "", tuple(runs)).figure()
    looks = {(line.line.color, line.line.dash) for line in figure.data if line.showlegend}
    assert len(looks) == len(runs)


def test_each_epoch_has_a_text_for_each_run():
    means = PLOT.means()
    texts = {run: of_run["text"].tolist() for run, of_run in means.groupby("run")}
    assert texts == {
        "skyocc": [
            "3.0 % (2.0 to 4.0, seeds: 2)",
            "4.5 % (4.0 to 5.0, seeds: 2)",
            "6.0 % (6.0 to 6.0, seeds: 1)",
        ],
        "baseline": ["3.0 %", "1.0 %"],
    }
    mean = next(line for line in PLOT.figure().data if line.line.width > 2)
    assert [text for (text,) in mean.customdata] == texts["skyocc"][:2]


@pytest.mark.parametrize(("epochs", "step"), [(1, 1), (3, 1), (24, 3), (100, 13)])
def test_ticks_are_whole_epochs(epochs, step):
    curve = Curve("a", tuple(range(1, epochs + 1)), (1.0,) * epochs)
    assert CurvePlot("Loss", "", (curve,)).figure().layout.xaxis.dtick == step


def test_a_loss_has_three_digits():
    table = CurvePlot("Loss", "", (Curve("a", (1, 2, 3), (1.2, 0.0345, 123.4)),)).means()
    assert table["text"].tolist() == ["1.20", "0.0345", "123"]


@pytest.mark.parametrize("curves", [(), (Curve("a", (), ()),)])
def test_a_plot_of_nothing_has_no_points(curves):
    assert CurvePlot("Loss", "", curves).points().empty


def test_names_are_no_markup_to_plotly_and_to_the_page():
    text = CurvePlot("<b>", "<i>", (Curve("</script><b>", (1,), (2.0,)),)).figure().to_json()
    assert "<" not in text
    line, *_ = json.loads(text)["data"]
    assert line["name"] == "&lt;/script&gt;&lt;b&gt;"
