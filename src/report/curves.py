"""Learning curves from the ``metrics.csv`` of a run."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..errors import UserError
from .curve_plot import Curve
from .figure_file import write_figure

TRAIN_LOSS = "train/total"
VALIDATION = {"val/kar_miou": "KAR-mIoU", "val/miou_occupied": "mIoU occupied"}
LOSS_COLORS, SCORE_COLORS = ("#d1495b",), ("#2962ff", "#00898a")
SIZE_INCHES, DPI = (9.0, 3.4), 150


def draw_curves(metrics_csv: str | Path, path: str | Path) -> None:
    """Writes a PNG of training loss and validation scores (%) against the epoch.

    ``metrics_csv`` is what Lightning's CSV logger writes: a column ``epoch``, and one for each
    quantity, empty in the rows where it was not logged. Several values in an epoch are averaged;
    what was never logged is left out. Raises `UserError` for a file that is missing, unreadable or
    without any of these columns, and for a path that cannot be written.
    """
    loss = read_curve(metrics_csv, TRAIN_LOSS, "training loss")
    # Scores are logged as shares, and drawn in percent.
    scores = [read_curve(metrics_csv, column, name, 100) for column, name in VALIDATION.items()]

    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    loss_axes, score_axes = figure.subplots(1, 2)
    _draw(loss_axes, "Training loss", [loss], LOSS_COLORS)
    _draw(score_axes, "Validation (%)", scores, SCORE_COLORS)
    write_figure(figure, path)


def read_curve(metrics_csv: str | Path, column: str, name: str, scale: float = 1.0) -> Curve:
    """Reads one column of a ``metrics.csv`` as the curve of a run: its mean in each epoch.

    It has no point in an epoch in which nothing was logged. Raises `UserError` as `draw_curves`
    does.
    """
    table = _read(metrics_csv)
    if column not in table:
        return Curve(name, (), ())

    values = table.dropna(subset=[column]).groupby("epoch")[column].mean() * scale
    # A mean of an epoch stands at its end.
    return Curve(name, tuple((values.index + 1.0).tolist()), tuple(values.tolist()))


def _read(metrics_csv: str | Path) -> pd.DataFrame:
    wanted = (TRAIN_LOSS, *VALIDATION)
    try:
        table = pd.read_csv(metrics_csv)
    except FileNotFoundError as error:
        raise UserError(f"{metrics_csv}: no such file; train first (task=fit)") from error
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"{metrics_csv}: not a readable table ({reason}); run again") from error

    if "epoch" not in table or not any(name in table for name in wanted):
        raise UserError(f"{metrics_csv}: has no epoch with any of {', '.join(wanted)}; run again")
    return table


def _draw(axes: Axes, title: str, curves: Sequence[Curve], colors: Sequence[str]) -> None:
    """Draws the curves that have points."""
    for curve, color in zip(curves, colors):
        if curve.epochs:
            style = {"color": color, "label": curve.name, "marker": "o", "markersize": 3.5}
            axes.plot(curve.epochs, curve.values, **style)

    axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
    axes.set_xlabel("epoch")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color="#e3e6ea")
    axes.spines[["top", "right"]].set_visible(False)
    if len(axes.lines) > 1:
        axes.legend(frameon=False)
