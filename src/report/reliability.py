"""Reliability diagrams: how often a voxel is occupied, over how probable it was called."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from ..metrics.count_metric import NamedCounts
from ..metrics.occupied_calibration import (
    FIXED_POINT,
    OCCUPIED,
    PROBABILITY,
    VOXELS,
    OccupiedCalibration,
)
from .canvas import INK, MUTED, write_figure
from .curve_plot import COLORS

SIZE_INCHES, DPI = (8.4, 4.2), 150
PARTS = {"bubble": "everywhere in the bubble", "tube": "in the tube ahead"}


def draw_reliability(
    metric: OccupiedCalibration, counts: Mapping[str, NamedCounts], path: str | Path
) -> None:
    """Writes a PNG with a curve for each of several ``counts`` of clips [clips, ...], in the bubble
    and in the tube.

    A point is a bin of equal mass; on the diagonal a probability is a frequency. Raises `UserError`
    for a path that cannot be written.
    """
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    for axes, (part, title) in zip(figure.subplots(1, 2, sharey=True), PARTS.items()):
        axes.plot([0, 100], [0, 100], color=MUTED, linewidth=1, linestyle=":")
        for (name, of_clips), color in zip(counts.items(), COLORS):
            bins = metric.equal_mass(of_clips[part].sum(0).double())
            bins = 100 * bins[bins[:, VOXELS] > 0] / bins[bins[:, VOXELS] > 0][:, :1]
            said, true = bins[:, PROBABILITY] / FIXED_POINT, bins[:, OCCUPIED]
            scores = metric.scores({key: each.sum(0) for key, each in of_clips.items()})
            ece = 100 * float(scores[f"{part.replace('bubble', 'occupied')}_ece"])
            label = f"{name}: ECE {ece:.1f} %"
            axes.plot(said, true, marker="o", markersize=4, color=color, label=label)

        axes.set_title(title, color=INK, fontsize=10)
        axes.set_xlabel("Called occupied with a probability of (%)", color=INK)
        axes.set_xlim(-2, 102)
        axes.set_ylim(-2, 102)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=8, loc="upper left")

    figure.axes[0].set_ylabel("Truly occupied (%)", color=INK)
    write_figure(figure, path)
