"""The cube as a picture: what each factor adds, and how sure that is."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from src.report.canvas import INK, MUTED, write_figure
from src.results.render import Cell, Table

SIZE_INCHES, DPI = (9.6, 3.8), 150
CAPTION = (
    "What each of the three factors adds, and the interactions (x), in percentage points, with "
    "paired intervals: the mean over models that differ in the factor alone."
)
# The tables whose effects are drawn, their color and their name.
DRAWN = {
    "cube": ("#2962ff", "as trained"),
    "cube_free_bias": ("#d1495b", "with the weight of free that validation prefers"),
}
# The scores that have axes.
AXES = {
    "KAR-mIoU": "KAR-mIoU (points)",
    "Primitive miss": "Primitive miss (points, less is better)",
}


def draw_cube(cube: Sequence[Table], path: Path) -> str:
    """Writes the effects in the tables that `cube_tables` gives, and returns the caption.

    Nothing is written, and the caption is empty, without them. Raises `UserError` for a path that
    cannot be written.
    """
    tables = {table.key: table for table in cube if table.key in DRAWN}
    if "cube" not in tables:
        return ""

    shown = {score: label for score, label in AXES.items() if _is_there(tables["cube"], score)}
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    all_axes = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, (score, label) in zip(all_axes, shown.items()):
        _draw(axes, score, tables)
        axes.set_xlabel(label, color=INK)
    names = [name for name, _ in tables["cube"].rows]
    all_axes[0].set_yticks(range(len(names)), names, fontsize=8)
    all_axes[0].invert_yaxis()
    if len(tables) > 1:
        handles, labels = all_axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", frameon=False, ncols=2)
    write_figure(figure, path)
    return CAPTION


def _is_there(table: Table, score: str) -> bool:
    """Whether a score has an effect; one that takes logits has none where there were labels."""
    cells = table.entries(score) if score in table.columns else []
    return any(isinstance(cell, Cell) and not math.isnan(cell.value) for cell in cells)


def _draw(axes: Axes, score: str, tables: Mapping[str, Table]) -> None:
    """Draws the effects on one score, those of several tables a little apart."""
    axes.axvline(0, color=MUTED, linewidth=1, zorder=0)
    for n, (key, table) in enumerate(tables.items()):
        color, label = DRAWN[key]
        apart = 0.24 * (n - (len(tables) - 1) / 2)
        for row, cell in enumerate(table.entries(score) if score in table.columns else []):
            if isinstance(cell, Cell):
                ends = [[cell.value - cell.low], [cell.high - cell.value]]
                place = {"fmt": "o", "markersize": 4, "capsize": 2, "linewidth": 1.4}
                once = label if row == 0 else None
                axes.errorbar(cell.value, row + apart, xerr=ends, color=color, label=once, **place)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
