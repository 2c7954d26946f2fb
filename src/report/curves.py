"""Learning curves from the ``metrics.csv`` of a run."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..errors import UserError
from .figure_file import write_figure

TRAIN_LOSS = "train/total"
VALIDATION = {"val/kar_miou": "KAR-mIoU", "val/miou_occupied": "mIoU occupied"}
SIZE_INCHES, DPI = (9.0, 3.4), 150


def draw_curves(metrics_csv: str | Path, path: str | Path) -> None:
    """Writes a PNG of training loss and validation scores (%) against the epoch.

    What was never logged is left out. Raises `UserError` as `read_curves` does, and for a path that
    cannot be written.
    """
    curves = read_curves(metrics_csv)
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    loss_axes, score_axes = figure.subplots(1, 2)
    _draw(loss_axes, "Training loss", curves, {TRAIN_LOSS: ("training loss", "#d1495b", 1)})
    # Scores are logged as shares, and drawn in percent.
    scores = zip(VALIDATION.items(), ("#2962ff", "#00898a"))
    styles = {column: (name, color, 100) for (column, name), color in scores}
    _draw(score_axes, "Validation (%)", curves, styles)
    write_figure(figure, path)


def read_curves(metrics_csv: str | Path) -> pd.DataFrame:
    """Reads the mean of every quantity in each epoch; a mean stands at the end of its epoch.

    ``metrics_csv`` is what Lightning's CSV logger writes: a column ``epoch``, and one for each
    quantity, empty in the rows where it was not logged. Raises `UserError` for a file that is
    missing, unreadable or without an epoch with a loss or a score of validation.
    """
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
    means = table.groupby("epoch").mean(numeric_only=True)
    return means.set_index(means.index + 1.0)


def _draw(
    axes: Axes, title: str, curves: pd.DataFrame, styles: Mapping[str, tuple[str, str, float]]
) -> None:
    """Draws the quantities that were logged, each with its name, color and scale."""
    for column, (name, color, scale) in styles.items():
        if column in curves and len(values := scale * curves[column].dropna()):
            axes.plot(values, color=color, label=name, marker="o", markersize=3.5)

    axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
    axes.set_xlabel("epoch")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color="#e3e6ea")
    axes.spines[["top", "right"]].set_visible(False)
    if len(axes.lines) > 1:
        axes.legend(frameon=False)
