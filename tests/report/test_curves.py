"""Learning curves: what is plotted of a log, the plots of several runs, and broken logs."""

import pandas as pd
import pytest
from PIL import Image

from src.errors import UserError
from src.report.curve_plot import COLORS, curve_plot
from src.report.curves import draw_curves, read_curves

METRICS = """epoch,step,train/total,val/kar_miou,val/miou_occupied
0,0,3.0,,
0,1,2.0,,
0,1,,0.1,0.2
1,2,1.0,,
1,3,,0.15,0.25
"""
NAN, INF = float("nan"), float("inf")
SEEDS = [
    *(("skyocc", 0, 1, 2.0), ("skyocc", 0, 2, 4.0), ("skyocc", 0, 3, 6.0)),
    *(("skyocc", 1, 1, 4.0), ("skyocc", 1, 2, 5.0), ("skyocc", 1, 3, INF), ("x", 3, 1, NAN)),
    *(("</script><b>", 2, 2, 1.0), ("</script><b>", 2, 1, 3.0)),
]


def plot_of(points, unit=""):
    return curve_plot(pd.DataFrame(points, columns=["run", "seed", "epoch", "value"]), unit)


def lines(figure, thick):
    """Name and points of the lines of one kind: means are thick, seeds are thin."""
    chosen = [line for line in figure.data if (line.line.width > 2) == thick]
    return [(line.name, list(zip(line.x, line.y))) for line in chosen]


def test_a_curve_is_the_mean_of_each_epoch_at_its_end_and_drawn_even_before_a_validation(tmp_path):
    path = tmp_path / "metrics.csv"
    for text in ("epoch,step,train/total\n0,0,1.5\n", METRICS):
        path.write_text(text)
        draw_curves(path, tmp_path / "figures/curves.png")
        with Image.open(tmp_path / "figures/curves.png") as image:
            assert image.size == (1350, 510)
    curves = read_curves(path)
    assert curves["train/total"].to_dict() == {1.0: 2.5, 2.0: 1.0}
    assert curves["val/kar_miou"].to_dict() == {1.0: 0.1, 2.0: 0.15}


@pytest.mark.parametrize("text", [None, "", "epoch,step\n0,1\n", "a,b\n1,2,3\n4,5,6,7\n"])
def test_a_missing_or_broken_log_is_named(tmp_path, text):
    path = tmp_path / "metrics.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError, match=r"metrics\.csv: .*; [^\n]*$"):
        draw_curves(path, tmp_path / "curves.png")


def test_a_thin_line_a_seed_and_a_thick_one_for_their_mean_which_ends_with_the_first_seed():
    figure = plot_of(SEEDS, "%")
    other = "&lt;/script&gt;&lt;b&gt;"
    assert lines(figure, thick=True) == [
        ("skyocc", [(1, 3.0), (2, 4.5)]),
        (other, [(1, 3.0), (2, 1.0)]),
    ]
    assert lines(figure, thick=False) == [
        ("skyocc", [(1, 2.0), (2, 4.0), (3, 6.0)]),
        ("skyocc", [(1, 4.0), (2, 5.0)]),
        (other, [(1, 3.0), (2, 1.0)]),
    ]
    colors = {(line.name, line.line.color) for line in figure.data}
    assert colors == {("skyocc", COLORS[0]), (other, COLORS[1])}
    assert [line.name for line in figure.data if line.showlegend] == ["skyocc", other]
    of_seeds = [[*map(float, each)] for line in figure.data[3:] for each in line.customdata]
    assert of_seeds == [[2, 4, 2], [4, 5, 2], [3, 3, 1], [1, 1, 1]]
    low_to_high = "%{customdata[0]:.1f} to %{customdata[1]:.1f}"
    text = f"%{{y:.1f}} % ({low_to_high}, seeds: %{{customdata[2]}})"
    assert {line.hovertemplate for line in figure.data[3:]} == {text}
    assert "<" not in figure.to_json(), "names are no markup"


def test_many_runs_look_unlike_each_other_and_a_loss_has_three_digits():
    count = 2 * len(COLORS) + 3
    points = [(f"run{n:02d}", n, epoch, 0.0345) for n in range(count) for epoch in (1, 2)]
    means = [line for line in plot_of(points).data if line.showlegend]
    assert len({(line.line.color, line.line.dash) for line in means}) == count
    assert means[0].hovertemplate.startswith("%{y:.3g} (")


@pytest.mark.parametrize(("epochs", "step"), [(1, 1), (3, 1), (24, 3), (100, 13)])
def test_ticks_are_whole_epochs(epochs, step):
    points = [("a", 0, epoch, 1.0) for epoch in range(1, epochs + 1)]
    assert plot_of(points).layout.xaxis.dtick == step


@pytest.mark.parametrize("points", [[], [("a", 0, 1, NAN)]])
def test_without_a_point_there_is_no_plot(points):
    assert plot_of(points) is None
