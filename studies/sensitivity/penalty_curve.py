"""The weight of an error by its distance: ``python -m studies.sensitivity.penalty_curve PNG``."""

from pathlib import Path

import torch
from matplotlib.figure import Figure

from src.metrics.functional import Penalty
from src.report.canvas import INK, MUTED, write_figure
from studies.settings import run

SPEEDS_MPS = (5.0, 8.0, 12.0)
COLORS = ("#2962ff", "#00898a", "#d1495b")
REACH_M, SIZE_INCHES, DPI = 70.0, (8.0, 3.6), 150


def draw_penalty(path: Path) -> None:
    """Write a PNG: the paper's penalty at three speeds by distance, the bubbles' edges dotted.

    Raises `UserError` for a path that cannot be written.
    """
    penalty = Penalty()
    distance_m = torch.linspace(0, REACH_M, 1401, dtype=torch.float64)
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    axes = figure.subplots()

    for speed_mps, color in zip(SPEEDS_MPS, COLORS):
        edge_m = penalty.horizon_s * speed_mps
        weight = 1 + penalty.excess(distance_m, speed_mps)
        # No UAV counts as slower than the least speed of the penalty.
        at_most = " or less" if speed_mps == penalty.min_speed_mps else ""
        label = f"{speed_mps:g} m/s{at_most}: bubble of {edge_m:g} m"
        inside = distance_m <= edge_m
        axes.plot(distance_m[inside], weight[inside], color=color, linewidth=2, label=label)
        axes.plot([edge_m, edge_m], [weight[inside][-1], 1], color=color, linewidth=1, ls=":")
    axes.plot([0, REACH_M], [1, 1], color=MUTED, linewidth=1, zorder=0)
    axes.text(0.5, 0.98, "IoU: every error weighs 1", va="top", color=MUTED, fontsize=9)
    axes.set_xlabel("distance of the voxel from the UAV (m)", color=INK)
    axes.set_ylabel("weight of an error", color=INK)
    axes.set_ylim(0.9, 3.1)
    axes.set_xlim(0, REACH_M)
    axes.legend(frameon=False, fontsize=9, title="speed", alignment="left")
    axes.spines[["top", "right"]].set_visible(False)

    write_figure(figure, path)


if __name__ == "__main__":
    run(draw_penalty)
