"""Scores by tilt and under a wrong attitude: the printed table, and the figure."""

from collections.abc import Mapping
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from rich import box
from rich.console import Console
from rich.table import Table

from ..atomic import replacing
from .attitude_evidence import TRUE, is_binned
from .canvas import INK, MUTED

SHOWN = {"miou_occupied": "mIoU occupied", "kar_miou": "KAR-mIoU", "iou/thin_structure": "thin"}
SCORE = "kar_miou"
COLORS = ("#2962ff", "#d1495b", "#00898a", "#8a5a00", "#6a3fb5", "#5a606a")
MARKERS = ("o", "s", "^", "D")
"""Another one when all colours have been used; what is dashed was told a level attitude."""
SIZE_INCHES, DPI = (11.0, 6.8), 130
TILT = "tilt |roll| + |pitch| (°), number of frames"
TOLD = "dashed: told level flight"
Styles = Mapping[str, tuple[str, str]]
"""The marker and the colour of each run."""
FAULTS = {"noise_deg": "noise of roll and pitch (°)", "delay_s": "delay of the attitude (s)"}


def print_attitude(table: pd.DataFrame, console: Console | None = None) -> None:
    """Print the main scores of every condition in percent, with their intervals over clips."""
    printed = Table(box=box.SIMPLE_HEAD, padding=(0, 1), title_justify="left")
    printed.title = "Scores (%) by tilt |roll| + |pitch|, and under a wrongly measured attitude"
    printed.add_column("condition", no_wrap=True)
    for name in ("frames", *SHOWN.values()):
        printed.add_column(name, justify="right", no_wrap=True)
    for condition, rows in table.groupby("condition", sort=False):
        scores = rows.set_index("score")
        cells = [_cell(scores.loc[name]) if name in scores.index else "–" for name in SHOWN]
        printed.add_row(condition, str(rows["frames"].iloc[0]), *cells)
    (console or Console(width=110)).print(printed)


def _cell(row: pd.Series) -> str:
    if np.isnan(row["value"]):
        return "–"
    if np.isnan(row["low"]):
        return f"{100 * row['value']:.1f}"
    return f"{100 * row['value']:.1f} \\[{100 * row['low']:.1f}, {100 * row['high']:.1f}]"


def draw_attitude(
    tables: Mapping[str, pd.DataFrame],
    path: str | Path,
    gains: Mapping[str, pd.DataFrame] | None = None,
    reference: str = "the baseline",
    worths: Mapping[str, pd.DataFrame] | None = None,
) -> None:
    """Write a PNG of KAR-mIoU by tilt, by noise and by delay, a line for each run's table, and a
    dashed one for what it has by tilt when told a level attitude. ``gains`` are tables of the
    differences from a ``reference`` in the same form, and ``worths`` of those from a level
    attitude; these stand by tilt as well.

    A table has a row a condition: ``condition``, its facts, ``frames``, and ``value``, ``low`` and
    ``high`` in [0, 1]. Bars are the intervals. Raises `UserError` for a path that cannot be
    written.
    """
    figure = attitude_figure(tables, gains or {}, reference, worths or {})
    with replacing(path) as temporary:
        FigureCanvasAgg(figure).print_png(temporary)


def attitude_figure(
    tables: Mapping[str, pd.DataFrame],
    gains: Mapping[str, pd.DataFrame],
    reference: str,
    worths: Mapping[str, pd.DataFrame],
) -> Figure:
    """What `draw_attitude` writes: above by tilt, below by fault."""
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    above, below = figure.subfigures(2, 1)
    styles = dict(zip(tables, cycle(product(MARKERS, COLORS))))
    differences = {
        f"gain over {reference} (points)": gains,
        "gain over told level (points)": worths,
    }
    differences = {said: found for said, found in differences.items() if found}
    first, *others = above.subplots(1, 1 + len(differences), squeeze=False)[0]
    _draw_tilt(first, tables, styles)
    _draw_level(first, tables, styles)
    _draw_legend(above, first)
    for axes, (said, found) in zip(others, differences.items()):
        axes.axhline(0, color=MUTED, linewidth=0.8)
        _draw_tilt(axes, found, styles)
        axes.set_ylabel(said, color=INK)
    faults = below.subplots(1, len(FAULTS))
    for axes, key in zip(faults, FAULTS):
        axes.sharey(first)
        _draw_fault(axes, tables, styles, key)
    for axes in (first, faults[0]):
        axes.set_ylabel("KAR-mIoU (%)", color=INK)
    first.set_ylim(bottom=0)
    return figure


def _draw_tilt(axes: Axes, tables: Mapping[str, pd.DataFrame], styles: Styles) -> None:
    for name, rows in tables.items():
        binned = rows[is_binned(rows) & ~rows["level"]]
        _line(axes, range(len(binned)), binned, name, styles[name])
        axes.set_xticks(range(len(binned)), [_bin_name(row) for _, row in binned.iterrows()])
    _finish(axes, TILT)


def _draw_level(axes: Axes, tables: Mapping[str, pd.DataFrame], styles: Styles) -> None:
    said = TOLD
    for name, rows in tables.items():
        binned = rows[is_binned(rows) & rows["level"]]
        if len(binned):
            values = 100 * binned["value"]
            axes.plot(range(len(binned)), values, "--", color=styles[name][1], label=said)
            said = f"_{TOLD}"


def _draw_legend(figure: SubFigure, axes: Axes) -> None:
    """Above the panels; runs in their order, and what is dashed last."""
    pairs = sorted(zip(*axes.get_legend_handles_labels()), key=lambda pair: pair[1] == TOLD)
    if len(pairs) > 1:
        figure.legend(*zip(*pairs), loc="outside upper center", ncols=4, frameon=False)


def _draw_fault(axes: Axes, tables: Mapping[str, pd.DataFrame], styles: Styles, key: str) -> None:
    for name, rows in tables.items():
        whole = rows[rows["condition"] == TRUE]
        faulty = pd.concat([whole, rows[rows[key] > 0].sort_values(key)])
        _line(axes, faulty[key], faulty, name, styles[name])
        axes.set_xticks(faulty[key])
    _finish(axes, FAULTS[key])


def _line(axes: Axes, places, rows: pd.DataFrame, name: str, style: tuple[str, str]) -> None:
    value, low, high = (100 * rows[key].to_numpy(float) for key in ("value", "low", "high"))
    reach = np.nan_to_num(np.abs(np.stack([value - low, high - value])))
    look = {"markersize": 4, "capsize": 3, "elinewidth": 1, "marker": style[0], "color": style[1]}
    axes.errorbar(list(places), value, yerr=reach, label=name, **look)


def _bin_name(row: pd.Series) -> str:
    low, high = row["tilt_low_deg"], row["tilt_high_deg"]
    bounds = f"{low:g}–{high:g}" if np.isfinite(high) else f"from {low:g}"
    return f"{bounds}\n{row['frames']}"


def _finish(axes: Axes, name: str) -> None:
    axes.set_xlabel(name, color=INK)
    axes.tick_params(colors=MUTED, labelsize=9)
    axes.grid(axis="y", color="#e3e6ea")
    axes.spines[["top", "right"]].set_visible(False)
