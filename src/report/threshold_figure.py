"""Collisions against time lost, over the planner's threshold: a coward never collides."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from ..results.flights import ALL
from .canvas import INK, MUTED, write_figure
from .curve_plot import COLORS

SIZE_INCHES, DPI = (6.4, 4.2), 150


def draw_thresholds(
    table: pd.DataFrame, curves: Mapping[str, Mapping[float, str]], path: str | Path
) -> None:
    """Writes a PNG of the table of `flight_scores`.

    ``curves`` has for each perception the thresholds that it flew with, and the name of the flights
    with each in the table. Perceptions that flew with one threshold are points. Raises `UserError`
    for a path that cannot be written.
    """
    of_all = table[table["stratum"] == ALL]
    values = 100 * of_all.pivot(index="perception", columns="score", values="value")
    values = values[["success_by_time", "collisions"]]
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    axes = figure.subplots()
    text = {"textcoords": "offset points", "fontsize": 8}

    for (name, of_name), color in zip(curves.items(), COLORS):
        points = values.loc[[of_name[threshold] for threshold in sorted(of_name)]]
        axes.plot(*points.T.to_numpy(), marker="o", markersize=4, color=color, label=name)
        for threshold, place in zip(sorted(of_name), points.to_numpy()):
            axes.annotate(f"{threshold:g}", place, xytext=(5, 4), color=INK, **text)

    drawn = [label for of_name in curves.values() for label in of_name.values()]
    for name, place in values.drop(drawn).iterrows():
        axes.scatter(*place, color=MUTED, marker="D", s=18)
        axes.annotate(str(name), place, xytext=(5, -9), color=MUTED, **text)

    axes.set_xlabel("Success, weighted by time (%)", color=INK)
    axes.set_ylabel("Flights that collide (%)", color=INK)
    axes.set_xlim(-2, 104)
    axes.set_ylim(bottom=-2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    write_figure(figure, path)
