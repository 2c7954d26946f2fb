"""``report.html``: a report of the ladder as a page to look at."""

from collections.abc import Mapping, Sequence
from mimetypes import guess_type
from pathlib import Path
from types import MappingProxyType

from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from ..atomic import replacing
from ..results.render import Table
from ..results.runs import ScoredRun
from ..run_folder import METRICS
from .curve_plot import CurvePlot
from .curves import TRAIN_LOSS, read_curve
from .ladder_report import LadderReport
from .picture import address
from .report_text import NUMBERS
from .scene import VoxelScene
from .scene_figure import scenes_figure
from .template import filled

# Columns of ``metrics.csv``, and the titles and units of their plots.
PLOTS = {
    "val/kar_miou": ("KAR-mIoU on validation", "%"),
    "val/miou": ("mIoU on validation", "%"),
    TRAIN_LOSS: ("Training loss, each rung its own", ""),
}


def write_report_page(
    report: LadderReport,
    heading: str,
    curves: Sequence[CurvePlot],
    figures: Mapping[Path, str],
    scenes: Sequence[VoxelScene],
    path: Path,
) -> None:
    """Writes the page, whole or not at all: one file that needs no network.

    ``figures`` maps pictures on disk to their captions. What is empty is left out, and all text is
    escaped. Raises `UserError` where the page cannot be written.
    """
    sections = {
        "Not a clean comparison": [report.unclean] if report.unclean.rows else [],
        "Facts": report.facts,
        "Tables": report.tables,
    }
    plots = [(plot.title, plot.figure()) for plot in curves if len(plot.points())]
    write_page(path, heading, sections, scenes, plots, figures, report.missing)


def write_page(
    path: Path,
    heading: str,
    sections: Mapping[str, Sequence[Table]],
    scenes: Sequence[VoxelScene],
    plots: Sequence[tuple[str, Figure]] = (),
    figures: Mapping[Path, str] = MappingProxyType({}),
    missing: Sequence[str] = (),
) -> None:
    """Writes a page of tables by section, titled plots, scenes and pictures, as
    `write_report_page` does."""
    plots = [*plots, *([("Scenes", scenes_figure(scenes))] if scenes else [])]
    page = filled(
        "page.html",
        heading=heading,
        missing=missing,
        sections=sections,
        numbers=NUMBERS.replace("`", ""),
        plotlyjs=get_plotlyjs(),
        plots=[(title, _plot_html(plot, f"plot-{n}")) for n, (title, plot) in enumerate(plots)],
        pictures=[
            (address(picture.read_bytes(), guess_type(picture)[0]), caption)
            for picture, caption in figures.items()
        ],
    )
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def _plot_html(plot: Figure, name: str) -> str:
    """Returns a plot without plotly's script; its name makes the same bytes of the same plot."""
    settings = {"full_html": False, "include_plotlyjs": False, "config": {"displaylogo": False}}
    return plot.to_html(div_id=name, **settings)


def learning_curves(named_runs: Sequence[tuple[str, ScoredRun]]) -> list[CurvePlot]:
    """Returns the curves of the runs that have a log.

    Raises `UserError` for a log that cannot be read.
    """
    logs = [(name, run.path / METRICS) for name, run in named_runs]
    logs = [(name, log) for name, log in logs if log.is_file()]
    plots = []
    for column, (title, unit) in PLOTS.items():
        scale = 100 if unit == "%" else 1
        curves = tuple(read_curve(log, column, name, scale) for name, log in logs)
        plots.append(CurvePlot(title, unit, curves))

    return plots if logs else []
