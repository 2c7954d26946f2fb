"""A report of the ladder as a page to read, ``report.md``, and one to look at, ``report.html``."""

from collections.abc import Mapping, Sequence
from mimetypes import guess_type
from pathlib import Path

import pandas as pd
from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from ..results.render import Table
from ..run_folder import METRICS
from .canvas import address
from .curve_plot import curve_plot
from .curves import TRAIN_LOSS, read_curves
from .ladder_report import LadderReport
from .run_group import RunGroup
from .scene import VoxelScene
from .scene_figure import scenes_figure
from .template import filled, write_text

TEXT, PAGE = "report.md", "report.html"

# A plot of plotly, and its title.
Plot = tuple[str, Figure]

# Plots are written without plotly's script, which the page has once.
PLAIN = {"full_html": False, "include_plotlyjs": False, "config": {"displaylogo": False}}
# Columns of ``metrics.csv``, and the titles and units of their plots.
PLOTS = {
    "val/kar_miou": ("KAR-mIoU on validation", "%"),
    "val/miou": ("mIoU on validation", "%"),
    TRAIN_LOSS: ("Training loss, each rung its own", ""),
}


def write_report_pages(
    report: LadderReport,
    plots: Sequence[Plot],
    figures: Mapping[Path, str],
    scenes: Sequence[VoxelScene],
    folder: Path,
) -> None:
    """Writes ``report.md`` and, as `write_page` does, ``report.html`` to a folder.

    ``figures`` maps pictures below the folder to their captions.
    """
    beside = {path.relative_to(folder).as_posix(): text for path, text in figures.items()}
    write_text(folder / TEXT, filled("report.md.j2", report=report, figures=beside))

    sections = {
        "Not a clean comparison": [report.unclean] if report.unclean.rows else [],
        "Facts": report.facts,
        "Tables": report.tables,
    }
    write_page(folder / PAGE, report.heading, sections, scenes, plots, figures, report.missing)


def write_page(
    path: Path,
    heading: str,
    sections: Mapping[str, Sequence[Table]],
    scenes: Sequence[VoxelScene],
    plots: Sequence[Plot] = (),
    figures: Mapping[Path, str] | None = None,
    missing: Sequence[str] = (),
) -> None:
    """Writes a page, whole or not at all: one file that needs no network.

    It has tables by section, titled plots, scenes, and pictures on disk with their captions. What
    is empty is left out, and all text is escaped. Raises `UserError` where it cannot be written.
    """
    plots = [*plots, *([("Scenes", scenes_figure(scenes))] if scenes else [])]

    page = filled(
        "page.html",
        heading=heading,
        missing=missing,
        sections=sections,
        plotlyjs=get_plotlyjs(),
        # Each has a name of its own, so that the same plot gives the same bytes.
        plots=[(t, plot.to_html(div_id=f"plot-{n}", **PLAIN)) for n, (t, plot) in enumerate(plots)],
        pictures=[
            (address(picture.read_bytes(), guess_type(picture)[0]), caption)
            for picture, caption in (figures or {}).items()
        ],
    )
    write_text(path, page)


def learning_curves(group: RunGroup) -> list[Plot]:
    """Returns the plots of the runs that have a log.

    Raises `UserError` for a log that cannot be read.
    """
    logs = [(group.ladder.row_name(run.experiment), run.path / METRICS) for run in group.runs]
    curves = [(name, read_curves(log)) for name, log in logs if log.is_file()]

    plots = []
    for column, (title, unit) in PLOTS.items():
        scale = 100 if unit == "%" else 1
        points = [
            (name, seed, epoch, scale * value)
            for seed, (name, means) in enumerate(curves)
            for epoch, value in means.get(column, pd.Series(dtype=float)).items()
        ]
        plot = curve_plot(pd.DataFrame(points, columns=["run", "seed", "epoch", "value"]), unit)
        plots += [(title, plot)] if plot else []
    return plots
