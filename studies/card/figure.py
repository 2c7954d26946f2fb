"""The paper's four panels of dataset statistics (App. A.1, "SkyShield Dataset and Generation")."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from src.ontology import ACTOR_TYPES, CLASSES, COLORS
from src.report.canvas import INK, MUTED, readable
from studies.card import paper
from studies.card.statistics import DENOMINATORS, LOW_FLIGHT_M, Statistics

SIZE_INCHES, DPI = (13.0, 8.6), 130
BAR, ACCENT = "#7d9cc0", "#d1495b"
HEIGHT_BIN_M = 0.5
DENOMINATOR_OPACITY = dict(zip(DENOMINATORS, (1.0, 0.55, 0.22)))
VOXEL_COLORS = {name: np.array(COLORS[name]) / 255 for name in CLASSES}
TITLES = {
    "A": "Clips (above) and frames (below), town by weather",
    "B": "Flight height",
    "C": "Voxels of each class (log)",
    "D": "Visible actors: mean of a frame, and their sum (figures)",
}
LEGEND = {"frameon": False, "fontsize": 9}


def statistics_figure(statistics: Statistics) -> Figure:
    """Draws axes A town by weather, B heights, C voxels of each class, D visible actors.

    The paper's own numbers are marked where it gives them.
    """
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained", facecolor="white")
    figure.get_layout_engine().set(w_pad=0.15, h_pad=0.15)

    panels = (_draw_matrix, _draw_heights, _draw_voxels, _draw_actors)
    for axes, draw, (letter, title) in zip(figure.subplots(2, 2).flat, panels, TITLES.items()):
        draw(axes, statistics)
        axes.set_title(f"$\\bf{{{letter}}}$  {title}", loc="left", fontsize=11, color=INK)
        if draw is not _draw_matrix:
            axes.grid(axis="y", color="#e3e6ea")
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_matrix(axes: Axes, statistics: Statistics) -> None:
    frames = statistics.by_town_and_weather(statistics.frames)
    clips = statistics.by_town_and_weather(statistics.clips)
    # The scale ends beyond the largest count, so that the darkest cell still carries dark text.
    axes.imshow(frames, cmap="Blues", vmin=0, vmax=2.2 * frames.to_numpy().max(), aspect="auto")
    axes.set_xticks(range(frames.shape[1]), map(readable, frames.columns), rotation=40, ha="right")
    axes.set_yticks(range(frames.shape[0]), map(readable, frames.index))

    for (row, column), count in np.ndenumerate(clips.to_numpy()):
        label = f"{count}\n{frames.iat[row, column]:,}" if count else "–"
        axes.text(column, row, label, ha="center", va="center", fontsize=8, color=INK)
    axes.set_xticks(np.arange(0.5, frames.shape[1] - 1), minor=True)
    axes.set_yticks(np.arange(0.5, frames.shape[0] - 1), minor=True)
    axes.grid(which="minor", color="white", linewidth=2)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_visible(False)


def _draw_heights(axes: Axes, statistics: Statistics) -> None:
    heights_m = statistics.frames["altitude_m"]
    last_m = max(LOW_FLIGHT_M + 1, float(np.ceil(heights_m.max())))
    axes.hist(heights_m, np.arange(0, last_m + HEIGHT_BIN_M, HEIGHT_BIN_M), color=BAR, ec="white")
    mean_m, below = heights_m.mean(), statistics.share_below()
    lines = (
        (mean_m, ACCENT, "-", f"mean {mean_m:.2f} m"),
        (paper.MEAN_HEIGHT_M, MUTED, ":", f"the paper's mean {paper.MEAN_HEIGHT_M} m"),
        (LOW_FLIGHT_M, INK, "--", f"{LOW_FLIGHT_M:g} m: {below:.1%} below, the paper's 86.1%"),
    )

    for height_m, color, style, label in lines:
        axes.axvline(height_m, color=color, linestyle=style, linewidth=1.8, label=label)
    # On white, so that no line runs through it; there is room for it.
    axes.legend(**{**LEGEND, "frameon": True, "framealpha": 1, "edgecolor": "white"})
    axes.set(xlabel="height above the ground (m)", ylabel="frames", xlim=(0, last_m))
    axes.set_ylim(top=1.3 * axes.get_ylim()[1])
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _draw_voxels(axes: Axes, statistics: Statistics) -> None:
    """Three bars a class, one for each denominator; most frequent class first."""
    shares = statistics.class_shares().sort_values("labelled", ascending=False)
    places = np.arange(len(shares))
    style = {"edgecolor": "#8a919c", "linewidth": 0.5}
    style["color"] = [VOXEL_COLORS[name] for name in shares.index]
    for n, (denominator, opacity) in enumerate(DENOMINATOR_OPACITY.items()):
        axes.bar(places + 0.27 * (n - 1), shares[denominator], 0.25, alpha=opacity, **style)
    labels = [percent(share) if share else "" for share in shares["labelled"]]
    axes.bar_label(axes.containers[0], labels, padding=3, fontsize=8.5, color=INK)

    reported = [(shares.index.get_loc(name), share) for name, share in paper.CLASS_SHARES.items()]
    diamonds = axes.scatter(*zip(*reported), marker="D", s=34, color="white", ec=INK, zorder=3)
    diamonds.set_label("the paper's (of which, it does not say)")
    grey = [
        Patch(facecolor=INK, alpha=0.75 * o, label=f"of {d} voxels".replace("in ", "in-"))
        for d, o in DENOMINATOR_OPACITY.items()
    ]
    axes.legend(handles=[*grey, diamonds], **LEGEND)
    # Free space is thousands of times as frequent as VRUs.
    least = min(*shares.to_numpy()[shares > 0], *paper.CLASS_SHARES.values())
    axes.set(yscale="log", ylabel="share of voxels", ylim=(10 ** np.floor(np.log10(least)), 4))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g}%"))
    axes.set_xticks(places, map(readable, shares.index), rotation=25, ha="right")


def _draw_actors(axes: Axes, statistics: Statistics) -> None:
    """Mean number of visible actors in a frame, beside the paper's, and the sum here above it."""
    here = statistics.visible_per_frame()
    reported = [paper.INSTANCES[name] / paper.FRAMES for name in here.index]
    places = np.arange(len(here))
    colors = [VOXEL_COLORS[CLASSES[ACTOR_TYPES[name]]] for name in here.index]
    bars = axes.bar(places - 0.2, here, 0.38, color=colors)
    sums = [f"{count:,}" for count in visible_totals(statistics).values()]
    axes.bar_label(bars, sums, padding=1, fontsize=8)

    hatched = {"facecolor": "white", "edgecolor": MUTED, "hatch": "////"}
    axes.bar(places + 0.2, reported, 0.38, label="the paper's", **hatched)
    axes.set_xticks(places, here.index)
    axes.set_ylabel("visible actors in a frame")
    axes.margins(y=0.1)
    axes.legend(**LEGEND)


def visible_totals(statistics: Statistics) -> dict[str, int]:
    """Visible actors summed over all frames, by type."""
    return {name: int(statistics.frames[f"visible/{name}"].sum()) for name in ACTOR_TYPES}


def percent(share: float) -> str:
    """A share in percent with three significant digits, as in the paper."""
    return f"{100 * share:.3g}%"
