"""Learning curves from the ``metrics.csv`` of a run."""

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..errors import UserError
from .canvas import write_figure

TRAIN_LOSS = "train/total"
# The quantities that are drawn: their axes, names and colors.
DRAWN = {
    TRAIN_LOSS: ("Training loss", "training loss", "#d1495b"),
    "val/kar_miou": ("Validation (%)", "KAR-mIoU", "#2962ff"),
    "val/miou_occupied": ("Validation (%)", "mIoU occupied", "#00898a"),
}
SIZE_INCHES, DPI = (9.0, 3.4), 150


def draw_curves(metrics_csv: str | Path, path: str | Path) -> None:
    """Writes a PNG of training loss and validation scores (%) against the epoch.

    What was never logged is left out. Raises `UserError` as `read_curves` does, and for a path that
    cannot be written.
    """
    curves = read_curves(metrics_csv)
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    titles = dict.fromkeys(title for title, _, _ in DRAWN.values())
    for axes, title in zip(figure.subplots(1, 2), titles):
        for column, (own, name, color) in DRAWN.items():
            values = curves.get(column, pd.Series(dtype=float)).dropna()
            if own == title and len(values):
                # Scores are logged as shares, and drawn in percent.
                values = values if column == TRAIN_LOSS else 100 * values
                axes.plot(values, color=color, label=name, marker="o", markersize=3.5)

        axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
        axes.set_xlabel("epoch")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(axis="y", color="#e3e6ea")
        axes.spines[["top", "right"]].set_visible(False)
        if len(axes.lines) > 1:
            axes.legend(frameon=False)
    write_figure(figure, path)


def read_curves(metrics_csv: str | Path) -> pd.DataFrame:
    """Reads the mean of every quantity in each epoch; a mean stands at the end of its epoch.

    ``metrics_csv`` is what Lightning's CSV logger writes: a column ``epoch``, and one for each
    quantity, empty in the rows where it was not logged. Raises `UserError` for a file that is
    missing, unreadable or without an epoch with a loss or a score of validation.
    """
    try:
        table = pd.read_csv(metrics_csv)
    except FileNotFoundError as error:
        raise UserError(f"{metrics_csv}: no such file; train first (task=fit)") from error
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"{metrics_csv}: not a readable table ({reason}); run again") from error

    if "epoch" not in table or not any(name in table for name in DRAWN):
        raise UserError(f"{metrics_csv}: has no epoch with any of {', '.join(DRAWN)}; run again")
    means = table.groupby("epoch").mean(numeric_only=True)
    return means.set_index(means.index + 1.0)
