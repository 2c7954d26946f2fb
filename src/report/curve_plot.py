"""Learning curves of several runs in one plot of plotly."""

import math
from dataclasses import dataclass
from html import escape

import numpy as np
import pandas as pd
import plotly.express as px
import plotly.graph_objects as go

# When all colors are used, the next runs have another kind of line.
COLORS = ["#3b7de0", "#dd5a52", "#1b9e77", "#c98a00", "#9361c9", "#d2559d", "#7a8b99", "#8c6d46"]
DASHES = [dash for dash in ("solid", "dash", "dot") for _ in COLORS]
LAYOUT = {
    "template": "none",
    "paper_bgcolor": "#0000",
    "plot_bgcolor": "#0000",
    "legend": {"orientation": "h", "y": -0.18},
    "margin": {"l": 56, "r": 12, "t": 8, "b": 40},
    "hovermode": "x unified",
    "hoverdistance": -1,
    "xaxis": {"title": {"text": "epoch", "standoff": 4}, "rangemode": "tozero"},
}


@dataclass(frozen=True)
class Curve:
    """One training: a quantity over the epochs, counted from 1.

    Curves of one ``name`` are the seeds of one run. Values that are not finite are left out.
    """

    name: str
    epochs: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class CurvePlot:
    """Curves of one quantity; ``unit`` stands behind its values, and may be empty."""

    title: str
    unit: str
    curves: tuple[Curve, ...]

    def points(self) -> pd.DataFrame:
        """Returns one row a point: run, seed (the number of its curve), epoch, value."""
        rows = [
            (curve.name, number, *point)
            for number, curve in enumerate(self.curves)
            for point in zip(curve.epochs, curve.values)
            if np.isfinite(point).all()
        ]
        return pd.DataFrame(rows, columns=["run", "seed", "epoch", "value"])

    def means(self) -> pd.DataFrame:
        """Returns mean, min, max and count over the seeds, and a text of them, by run and epoch."""
        points = self.points()
        by_epoch = points.groupby(["run", "epoch"], sort=False)["value"]
        means = by_epoch.agg(["mean", "min", "max", "count"]).reset_index()
        means["seeds"] = means["run"].map(points.groupby("run")["seed"].nunique())
        means["text"] = [self._text(*row[2:]) for row in means.itertuples(index=False)]
        return means.sort_values("epoch", kind="stable")

    def _text(self, mean: float, low: float, high: float, count: int, seeds: int) -> str:
        """Returns one decimal of a percentage, and three digits of anything else."""
        form = ".1f" if self.unit == "%" else "#.3g"
        mean, low, high = (format(value, form).rstrip(".") for value in (mean, low, high))
        text = f"{mean} {self.unit}".rstrip()
        return text if seeds == 1 else f"{text} ({low} to {high}, seeds: {count})"

    def figure(self) -> go.Figure:
        """Returns the plot: thin lines are the seeds of a run, a thick one is their mean."""
        points = self.points().assign(run=lambda table: table["run"].map(_plain))
        means = self.means().assign(run=lambda table: table["run"].map(_plain))

        # At an epoch that some seeds lack, the mean would jump and nothing was learned.
        means = means[means["count"] == means["seeds"]]

        order = {"run": list(points["run"].unique())}
        sequences = {"color_discrete_sequence": COLORS, "line_dash_sequence": DASHES}
        style = {"x": "epoch", "color": "run", "line_dash": "run", "category_orders": order}
        points = points.sort_values("epoch")
        thin = px.line(points, y="value", line_group="seed", **style, **sequences)
        thin.update_traces(line_width=1, opacity=0.5, showlegend=False)
        thin.update_traces(hoverinfo="skip", hovertemplate=None)
        thick = px.line(means, y="mean", custom_data="text", markers=True, **style, **sequences)
        thick.update_traces(line_width=2.5, hovertemplate="%{customdata[0]}")

        figure = go.Figure([*thin.data, *thick.data], LAYOUT)
        # About eight ticks, none of them between two epochs.
        figure.update_xaxes(dtick=math.ceil(points["epoch"].max() / 8))
        return figure.update_yaxes(ticksuffix=_plain(f" {self.unit}".rstrip()))


def _plain(text: str) -> str:
    """Returns a text that plotly shows as it is: it reads names as markup of its own."""
    return escape(text, quote=False)
