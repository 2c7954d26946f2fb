"""The figure of scores by tilt and under wrong poses."""

from collections.abc import Mapping
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from src.report.canvas import INK, MUTED, write_figure
from studies.attitude.tables import AttitudeScores

# Another marker is taken when all colors have been used.
COLORS = ("#2962ff", "#d1495b", "#00898a", "#8a5a00", "#6a3fb5", "#5a606a", "#f08c00", "#e64fb0")
MARKERS = ("o", "s", "^", "D")
WIDTH_INCHES, ROW_INCHES, DPI = 11.0, 3.4, 130

TILT = "tilt |roll| + |pitch| (°), number of frames"
TOLD = "dashed: told level flight"
FAULTS = {
    **{"noise_deg": "noise of roll and pitch (°)", "delay_s": "delay of roll and pitch (s)"},
    **{"distance_off": "distances too long by (share)", "time_off_s": "times off by (s)"},
}
CAPTION = (
    "KAR-mIoU by tilt, what it gains over {reference}, and, where that was scored, what the true "
    "attitude gains over being told that the UAV flies level; below, under wrongly measured "
    "poses. Bars are intervals, as in the tables."
)

# The marker and the color of each run.
Styles = Mapping[str, tuple[str, str]]
# Of each run a row a condition: its facts, ``frames``, and ``value``, ``low`` and ``high`` in
# [0, 1].
Rows = Mapping[str, pd.DataFrame]


def draw_report_attitude(attitude: AttitudeScores, path: Path) -> str:
    """Writes the figure of all experiments and returns its caption.

    Nothing is written, and the caption is empty, where no run was scored by tilt.
    """
    ladder, names = attitude.ladder, attitude.names(list(attitude.resamples))
    if not names:
        return ""

    changes = {
        f"gain over {ladder.reference} (points)": {
            ladder.row_name(name): attitude.rows(name, ladder.first) for name in names
        },
        "gain over told level (points)": {
            ladder.row_name(name): attitude.rows(name, name, "level") for name in names
        },
    }
    scores = {ladder.row_name(name): attitude.rows(name) for name in names}
    draw_attitude(scores, path, changes)
    return CAPTION.format(reference=ladder.reference)


def draw_attitude(
    scores: Rows, path: str | Path, changes: Mapping[str, Rows] | None = None
) -> None:
    """Writes a PNG of KAR-mIoU by tilt and by each fault, with a line for each run, and a
    dashed one for its scores by tilt when told a level attitude.

    ``changes`` are differences by tilt, by what they are over; those without a row are left out.
    Bars are the intervals. Raises `UserError` for a path that cannot be written.
    """
    # Rungs without a common seed have no difference.
    kept = {
        name: {run: rows for run, rows in of_runs.items() if len(rows)}
        for name, of_runs in (changes or {}).items()
    }

    figure = attitude_figure(scores, {name: rows for name, rows in kept.items() if rows})
    write_figure(figure, path)


def attitude_figure(scores: Rows, changes: Mapping[str, Rows]) -> Figure:
    """Returns the figure of `draw_attitude`: above by tilt, below by fault, where there is one."""
    faults = [key for key in FAULTS if any((rows[key] > 0).any() for rows in scores.values())]
    size_inches = WIDTH_INCHES, ROW_INCHES * (2 if faults else 1)
    figure = Figure(figsize=size_inches, dpi=DPI, layout="constrained")
    above, *below = figure.subfigures(2 if faults else 1, 1, squeeze=False)[:, 0]
    styles = dict(zip(scores, cycle(product(MARKERS, COLORS))))

    first, *others = above.subplots(1, 1 + len(changes), squeeze=False)[0]
    _draw_tilt(first, scores, styles)
    _draw_level(first, scores, styles)
    _draw_legend(above, first)
    for axes, (name, rows) in zip(others, changes.items()):
        axes.axhline(0, color=MUTED, linewidth=0.8)
        _draw_tilt(axes, rows, styles)
        axes.set_ylabel(name, color=INK)

    first.set_ylabel("KAR-mIoU (%)", color=INK)
    for figure_below in below:
        for axes, key in zip(figure_below.subplots(1, len(faults), squeeze=False)[0], faults):
            axes.sharey(first)
            _draw_fault(axes, scores, styles, key)
            axes.set_ylabel("KAR-mIoU (%)", color=INK)
    first.set_ylim(bottom=0)
    return figure


def _is_bin(rows: pd.DataFrame) -> pd.Series:
    return (rows["tilt_low_deg"] > 0) | (rows["tilt_high_deg"] < float("inf"))


def _draw_tilt(axes: Axes, scores: Rows, styles: Styles) -> None:
    for name, rows in scores.items():
        bins = rows[_is_bin(rows) & ~rows["level"]]
        _line(axes, range(len(bins)), bins, name, styles[name])
        axes.set_xticks(range(len(bins)), [_bin_name(row) for _, row in bins.iterrows()])
    _finish(axes, TILT)


def _draw_level(axes: Axes, scores: Rows, styles: Styles) -> None:
    label = TOLD
    for name, rows in scores.items():
        bins = rows[_is_bin(rows) & rows["level"]]
        if len(bins):
            axes.plot(range(len(bins)), 100 * bins["value"], "--", color=styles[name][1],
                      label=label)  # fmt: skip
            # matplotlib leaves names that begin with a line out of the legend.
            label = f"_{TOLD}"


def _draw_legend(figure: SubFigure, axes: Axes) -> None:
    """Draws it above the panels; runs in their order, and the dashed lines last."""
    pairs = sorted(zip(*axes.get_legend_handles_labels()), key=lambda pair: pair[1] == TOLD)
    if len(pairs) > 1:
        figure.legend(*zip(*pairs), loc="outside upper center", ncols=4, frameon=False)


def _draw_fault(axes: Axes, scores: Rows, styles: Styles, key: str) -> None:
    for name, rows in scores.items():
        is_true = ~_is_bin(rows) & ~rows["level"] & (rows[list(FAULTS)] == 0).all(axis=1)
        faulty = pd.concat([rows[is_true], rows[rows[key] > 0].sort_values(key)])
        _line(axes, faulty[key], faulty, name, styles[name])
        axes.set_xticks(faulty[key], [f"{value:g}" for value in faulty[key]])
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
