"""How well scores foretell what comes of flights, as pictures."""

import math
from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from src.report.canvas import INK, MUTED, write_figure
from studies.foretelling.correlation import ALL

DPI, WIDTH_INCHES, ROW_INCHES = 150, 4.2, 0.22
# Of each stratum; over all it is black.
COLORS = ("#2962ff", "#d1495b", "#2a9d8f", "#c98a00")
PANELS, PANEL_INCHES = 5, (2.3, 2.0)


def draw_foretelling(table: pd.DataFrame, path: str | Path) -> None:
    """Writes a PNG of the correlations with collisions in the table of `foretelling`.

    There are axes for each set of frames and a row a score; points are the strata, and over all
    there is the interval. Raises `UserError` for a path that cannot be written.
    """
    table = table[table["target"] == "collisions"]
    sets, scores = table["frames"].unique(), list(table["score"].unique())

    size = WIDTH_INCHES * (len(sets) + 0.5), ROW_INCHES * len(scores) + 1.2
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    all_axes = figure.subplots(1, len(sets), sharey=True, squeeze=False)[0]
    strata = [name for name in table["stratum"].unique() if name != ALL]

    for axes, frames in zip(all_axes, sets):
        of_set = table[table["frames"] == frames].set_index(["stratum", "score"])
        axes.axvline(0, color=MUTED, linewidth=1, zorder=0)
        for stratum, color in zip(strata, cycle(COLORS)):
            if stratum in of_set.index:
                values = of_set.loc[stratum]["spearman"].reindex(scores)
                axes.scatter(values, range(len(scores)), s=14, color=color, label=stratum, zorder=3)
        over = of_set.loc[ALL].reindex(scores)
        # A percentile interval need not hold its value.
        axes.hlines(range(len(scores)), over["low"], over["high"], color=INK, linewidth=1.2)
        axes.scatter(
            over["spearman"], range(len(scores)), s=22, color=INK, marker="D", label="all strata"
        )

        axes.set_title(f"frames: {frames}", fontsize=10, color=INK)
        axes.set_xlabel("Spearman with fewer collisions", color=INK)
        axes.set_xlim(-1.05, 1.05)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(left=False)

    all_axes[0].set_yticks(range(len(scores)), scores, fontsize=8)
    all_axes[0].invert_yaxis()
    handles, labels = all_axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", frameon=False, ncols=4)
    write_figure(figure, path)


def draw_standings(
    standings: pd.DataFrame,
    table: pd.DataFrame,
    scores: Mapping[str, str],
    reference: str,
    path: str | Path,
) -> None:
    """Writes a PNG of the perceptions of a set of frames, as `foretelling` returns them.

    There are axes for each score, its better end to the right, with its correlation over all
    strata; points are perceptions, and higher ones collide more often than the reference does.
    Raises `UserError` for a path that cannot be written.
    """
    over = table[(table["stratum"] == ALL) & (table["target"] == "collisions")]
    found = over[over["frames"] == standings["frames"].iloc[0]].set_index("score")["spearman"]
    columns = min(PANELS, len(scores))
    rows = math.ceil(len(scores) / columns)
    size = PANEL_INCHES[0] * columns, PANEL_INCHES[1] * rows + 0.5
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    all_axes = list(figure.subplots(rows, columns, sharey=True, squeeze=False).flat)

    for axes, (score, end) in zip(all_axes, scores.items()):
        for (stratum, own), color in zip(standings.groupby("stratum"), cycle(COLORS)):
            values = 100 * own[[score, "collisions"]]
            axes.scatter(*values.to_numpy().T, s=12, color=color, label=stratum, alpha=0.7)
        if end == "low":
            axes.invert_xaxis()
        axes.set_title(f"{score}  {found.get(score, math.nan):+.2f}", fontsize=8, color=INK)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in all_axes[len(scores) :]:
        axes.set_axis_off()

    figure.supylabel(f"collisions beyond those of {reference}, % of flights", fontsize=9)
    figure.supxlabel("score (%), better to the right; beside its name: Spearman", fontsize=9)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", frameon=False, ncols=len(labels))
    write_figure(figure, path)
