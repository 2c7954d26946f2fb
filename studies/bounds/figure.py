"""The figure of floor and ceiling: the score by the error of the depth."""

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from src.report.canvas import INK, MUTED, write_figure

SIZE_INCHES, DPI = (7.6, 4.6), 150
# Color and style of each line, by what is told and how the error is drawn.
LINES = {
    ("image", False): ("#2962ff", "-", "true attitude, smooth error"),
    ("pixel", False): ("#2962ff", ":", "true attitude, error of each pixel by itself"),
    ("image", True): ("#d1495b", "-", "told level flight, smooth error"),
    ("pixel", True): ("#d1495b", ":", "told level flight, error of each pixel by itself"),
}
FLOORS = {"height_prior": "no image,\ntold the height", "voxel_prior": "no image"}


def draw_bounds(table: pd.DataFrame, path: Path) -> None:
    """Writes a PNG of KAR-mIoU by the error of the depth, for one frame, with intervals over clips.

    ``table`` has a row a bound: the fields of its sight, which are empty for a floor and for a
    trained run, whose ``depth_error`` alone is there, and ``value``, ``low`` and ``high`` in
    [0, 1]. Raises `UserError` for a path that cannot be written.
    """
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    axes = figure.subplots()

    rows = table.set_index("bound")
    for name, label in FLOORS.items():
        value = 100 * rows.loc[name, "value"]
        axes.axhline(value, color=MUTED, linewidth=1, zorder=0)
        place = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": 8}
        axes.text(1.01, value, f"{label}: {value:.1f}", color=MUTED, **place)

    _draw_lines(axes, table[(table["images"] == 1) & (table["attitude_deg"] == 0)])
    _draw_runs(axes, table[table["images"].isna() & table["depth_error"].notna()])

    axes.set_xlabel("error of the depth, mean of |log| (%)", color=INK)
    axes.set_ylabel("KAR-mIoU (%)", color=INK)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    write_figure(figure, path)


def _draw_lines(axes: Axes, sights: pd.DataFrame) -> None:
    exact = sights[sights["depth_error"] == 0]
    for (by, level), (color, style, label) in LINES.items():
        # Without an error of the depth there is nothing to draw by image or pixel.
        own = pd.concat([exact, sights[(sights["by"] == by) & (sights["depth_error"] > 0)]])
        own = own[own["level"] == level].sort_values("depth_error")
        _draw(axes, own, color=color, linestyle=style, label=label, marker="o", markersize=3)


def _draw_runs(axes: Axes, runs: pd.DataFrame) -> None:
    """Draws trained models, each with its name beside it."""
    if runs.empty:
        return
    _draw(axes, runs, color=INK, linestyle="", label="trained", marker="D", markersize=5)
    for _, run in runs.iterrows():
        place = (100 * run["depth_error"], 100 * run["value"])
        beside = {"xytext": (6, 4), "textcoords": "offset points", "fontsize": 8}
        axes.annotate(run["bound"], place, color=INK, **beside)


def _draw(axes: Axes, rows: pd.DataFrame, **style: object) -> None:
    x, value = 100 * rows["depth_error"], 100 * rows["value"]
    bars = [value - 100 * rows["low"], 100 * rows["high"] - value]
    axes.errorbar(x, value, bars, capsize=2, linewidth=1.6, elinewidth=0.8, **style)
