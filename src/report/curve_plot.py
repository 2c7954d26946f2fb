"""Learning curves of several runs in one plot of plotly."""

import math
from html import escape

import pandas as pd
import plotly.express as px
import plotly.graph_objects as go

# When all colors are used, the next runs have another kind of line.
COLORS = ["#3b7de0", "#dd5a52", "#1b9e77", "#c98a00", "#9361c9", "#d2559d", "#7a8b99", "#8c6d46"]
LINES = {
    "color_discrete_sequence": COLORS,
    "line_dash_sequence": [dash for dash in ("solid", "dash", "dot") for _ in COLORS],
}
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


def curve_plot(points: pd.DataFrame, unit: str = "") -> go.Figure | None:
    """Returns the plot of one quantity: thin lines are the seeds of a run, a thick one their mean.

    ``points`` has a row a point: ``run``, the number ``seed`` of its curve, ``epoch`` (from 1) and
    ``value``. What is not finite is left out, and without any point there is no plot. ``unit``
    stands behind the values.
    """
    points = points[points["value"].astype(float).abs() < math.inf]
    if points.empty:
        return None
    # Plotly would read a name as markup.
    points = points.assign(run=points["run"].map(escape))

    by_epoch = points.groupby(["run", "epoch"], sort=False)["value"]
    means = by_epoch.agg(["mean", "min", "max", "count"]).reset_index()
    # At an epoch that some seeds lack, the mean would jump and nothing was learned.
    seeds = means["run"].map(points.groupby("run")["seed"].nunique())
    means = means[means["count"] == seeds].sort_values("epoch", kind="stable")

    order = {"run": list(points["run"].unique())}
    style = {"x": "epoch", "color": "run", "line_dash": "run", "category_orders": order, **LINES}
    thin = px.line(points.sort_values("epoch"), y="value", line_group="seed", **style)
    thin.update_traces(line_width=1, opacity=0.5, showlegend=False)
    thin.update_traces(hoverinfo="skip", hovertemplate=None)
    thick = px.line(means, y="mean", custom_data=["min", "max", "count"], markers=True, **style)
    # One decimal of a percentage, and three digits of anything else.
    form, unit = ".1f" if unit == "%" else ".3g", f" {escape(unit)}".rstrip()
    low, high = (f"%{{customdata[{n}]:{form}}}" for n in range(2))
    text = f"%{{y:{form}}}{unit} ({low} to {high}, seeds: %{{customdata[2]}})"
    thick.update_traces(line_width=2.5, hovertemplate=text)

    figure = go.Figure([*thin.data, *thick.data], LAYOUT)
    # About eight ticks, none of them between two epochs.
    figure.update_xaxes(dtick=math.ceil(points["epoch"].max() / 8))
    return figure.update_yaxes(ticksuffix=unit)
