"""Learning curves: what is plotted, and broken files."""

import math

import pytest
from matplotlib.figure import Figure
from PIL import Image

from src.errors import UserError
from src.report.curve_plot import Curve
from src.report.curves import _draw, draw_curves, read_curve

METRICS = """epoch,step,train/total,val/kar_miou,val/miou_occupied
0,0,3.0,,
0,1,2.0,,
0,1,,0.1,0.2
1,2,1.0,,
1,3,,0.15,0.25
"""


@pytest.fixture(name="metrics_csv")
def _metrics_csv(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text(METRICS)
    return path


def test_the_figure_is_written_even_before_the_first_validation(tmp_path, metrics_csv):
    for text in (METRICS, "epoch,step,train/total\n0,0,1.5\n"):
        metrics_csv.write_text(text)
        draw_curves(metrics_csv, tmp_path / "figures" / "curves.png")
        with Image.open(tmp_path / "figures" / "curves.png") as image:
            assert image.format == "PNG"
            assert math.isclose(image.width / image.height, 9.0 / 3.4, rel_tol=0.01)


def test_two_runs_draw_the_same_bytes(tmp_path, metrics_csv):
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    for path in paths:
        draw_curves(metrics_csv, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize(
    "text", [None, "", "hello\n", "epoch,step\n0,1\n", "a,b\n1,2,3\n4,5,6,7\n"]
)
def test_a_missing_or_broken_file_is_named(tmp_path, metrics_csv, text):
    metrics_csv.unlink()
    if text is not None:
        metrics_csv.write_text(text)
    with pytest.raises(UserError, match=r"metrics\.csv: ") as caught:
        draw_curves(metrics_csv, tmp_path / "curves.png")
    assert "\n" not in str(caught.value)


def test_a_curve_is_the_mean_of_each_epoch_at_its_end(metrics_csv):
    assert read_curve(metrics_csv, "train/total", "loss") == Curve("loss", (1.0, 2.0), (2.5, 1.0))
    score = read_curve(metrics_csv, "val/kar_miou", "skyocc", scale=100)
    assert score == Curve("skyocc", (1.0, 2.0), (10.0, 15.0))
    assert read_curve(metrics_csv, "val/miou", "skyocc") == Curve("skyocc", (), ())


def test_a_curve_is_drawn_as_it_is_and_one_without_points_is_not():
    axes = Figure().subplots()
    loss, empty = Curve("loss", (1.0, 2.0), (2.5, 1.0)), Curve("mIoU", (), ())
    _draw(axes, "Training loss", [loss, empty], ("black", "red"))
    (line,) = axes.lines
    assert line.get_xydata().tolist() == [[1, 2.5], [2, 1.0]]
