"""Learning curves from the ``metrics.csv`` of a run."""

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
COLORS = ("#d1495b", "#2962ff", "#00898a")
SIZE_INCHES, DPI = (9.0, 3.4), 150


def draw_curves(metrics_csv: str | Path, path: str | Path) -> None:
    """Writes a PNG of training loss and validation scores (%) against the epoch.

    ``metrics_csv`` is what Lightning's CSV logger writes: a column ``epoch``, and one for each
    quantity, empty in the rows where it was not logged. Several values in an epoch are averaged;
    what was never logged is left out. Raises `UserError` for a file that is missing, unreadable or
    without any of these columns, and for a path that cannot be written.
    """
    table = _read(metrics_csv)
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    loss_axes, score_axes = figure.subplots(1, 2)

    _draw(loss_axes, table, TRAIN_LOSS, "training loss", COLORS[0])
    # Scores are logged as shares, and drawn in percent.
    for (column, label), color in zip(VALIDATION.items(), COLORS[1:]):
        _draw(score_axes, table, column, label, color, scale=100)
    for axes, title in ((loss_axes, "Training loss"), (score_axes, "Validation (%)")):
        _finish(axes, title)
    write_figure(figure, path)


def read_curve(metrics_csv: str | Path, column: str, name: str, scale: float = 1.0) -> Curve:
    """Reads one column of a ``metrics.csv`` as the curve of a run.

    It has no point in an epoch in which nothing was logged. Raises `UserError` as `draw_curves`
    does.
    """
    return _curve(_read(metrics_csv), column, name, scale)


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


def _draw(
    axes: Axes, table: pd.DataFrame, column: str, label: str, color: str, scale: float = 1.0
) -> None:
    """Draws one curve, where the column was logged."""
    curve = _curve(table, column, label, scale)
    if curve.epochs:
        style = {"color": color, "label": label, "marker": "o", "markersize": 3.5}
        axes.plot(curve.epochs, curve.values, **style)


def _curve(table: pd.DataFrame, column: str, name: str, scale: float) -> Curve:
    """Returns the mean of a column in each epoch, at the epoch's end; empty where never logged."""
    if column not in table:
        return Curve(name, (), ())
    values = table.dropna(subset=[column]).groupby("epoch")[column].mean() * scale
    return Curve(name, tuple((values.index + 1.0).tolist()), tuple(values.tolist()))


def _finish(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
    axes.set_xlabel("epoch")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color="#e3e6ea")
    axes.spines[["top", "right"]].set_visible(False)
    if len(axes.lines) > 1:
        axes.legend(frameon=False)
