"""A heat map of KAR-mIoU under other parameters."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from src.metrics.functional import Penalty
from src.report.canvas import INK, MUTED, write_figure
from studies.sensitivity.metric import PARAMETERS

SYMBOLS = dict(zip(PARAMETERS, ("$v_{min}$ (m/s)", "$T_h$ (s)", r"$\lambda$ (1/s)", r"$\gamma$")))
CELL_INCHES, DPI = 0.62, 110
PANELS_A_ROW = 2


def draw_sensitivity(table: pd.DataFrame, runs: Sequence[str], path: str | Path) -> None:
    """Writes a PNG: a heat map for every run, T_h and lambda down, v_min and gamma across.

    Figures are KAR-mIoU in percent with the run's rank below; a frame marks the paper's
    parameters. Raises `UserError` for a path that cannot be written.
    """
    # Two parameters a side make one flat map of the four.
    down, across = ("horizon_s", "decay_per_s"), ("min_speed_mps", "penalty_scale")
    size = [len(table[list(keys)].drop_duplicates()) for keys in (down, across)]
    columns = min(len(runs), PANELS_A_ROW)
    rows = -(-len(runs) // columns)
    width = columns * (size[1] * CELL_INCHES + 0.5) + 1.6
    height = rows * (size[0] * CELL_INCHES + 1.4) + 0.5

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in panels[len(runs) :]:
        unused.set_axis_off()
    shades = _shades(table[list(runs)].to_numpy())
    for n, (axes, run) in enumerate(zip(panels, runs)):
        cells, ranks = (
            table.pivot(index=list(down), columns=list(across), values=column)
            for column in (run, f"rank {run}")
        )
        _draw_panel(axes, cells, ranks if len(runs) > 1 else None, shades)
        axes.set_xlabel(f"{SYMBOLS[across[0]]}, below it {SYMBOLS[across[1]]}", color=INK)
        if n % columns == 0:
            axes.set_ylabel(f"{SYMBOLS[down[0]]}, {SYMBOLS[down[1]]}", color=INK)
        axes.set_title(run, loc="left", fontsize=11, fontweight="bold", color=INK)

    figure.suptitle("KAR-mIoU (%) under other parameters; framed: the paper's", fontsize=11)
    write_figure(figure, path)


def _shades(scores: np.ndarray) -> tuple[float, float]:
    """Returns the scores of the lightest and of the darkest color; text is unreadable on it."""
    lowest, highest = scores.min(), scores.max()
    return lowest, lowest + 1.5 * (highest - lowest)


def _draw_panel(
    axes: Axes, cells: pd.DataFrame, ranks: pd.DataFrame | None, shades: tuple[float, float]
) -> None:
    """Draws the scores of one run, with its ranks where there are others."""
    axes.imshow(cells, cmap="YlGnBu", vmin=shades[0], vmax=shades[1])
    for (row, column), value in np.ndenumerate(cells.to_numpy()):
        rank = "" if ranks is None else f"\n#{ranks.iat[row, column]}"
        label = f"{100 * value:.1f}{rank}"
        axes.text(column, row, label, ha="center", va="center", fontsize=8, color=INK)

    axes.set_xticks(range(cells.shape[1]), [f"{a:g}\n{b:g}" for a, b in cells.columns])
    axes.set_yticks(range(cells.shape[0]), [f"{a:g}, {b:g}" for a, b in cells.index])
    axes.tick_params(length=0, labelsize=9, colors=MUTED)
    axes.spines[:].set_visible(False)
    _mark_paper(axes, cells)


def _mark_paper(axes: Axes, cells: pd.DataFrame) -> None:
    paper = Penalty()
    row, column = (paper.horizon_s, paper.decay_per_s), (paper.min_speed_mps, paper.penalty_scale)
    if row in cells.index and column in cells.columns:
        corner = (cells.columns.get_loc(column) - 0.5, cells.index.get_loc(row) - 0.5)
        axes.add_patch(Rectangle(corner, 1, 1, fill=False, edgecolor="#d1495b", linewidth=2))
