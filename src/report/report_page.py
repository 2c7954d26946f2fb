"""``report.html``: a report of the ladder as a page to look at."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ..results.render import Table, table_of
from ..results.runs import ScoredRun
from ..run_folder import METRICS
from .curve_plot import CurvePlot
from .curves import TRAIN_LOSS, read_curve
from .ladder_report import LadderReport
from .page import SETTINGS, TABLES, write_page
from .picture import Picture
from .report_text import NUMBERS, facts_of, settings_rows
from .scene import Scene
from .shared_settings import Values

PLOTS = {
    "val/kar_miou": ("KAR-mIoU on validation", "%"),
    "val/miou": ("mIoU on validation", "%"),
    TRAIN_LOSS: ("Training loss, each rung its own", ""),
}
"""Columns of ``metrics.csv``, and the titles and units of their plots."""


def write_report_page(
    report: LadderReport,
    heading: str,
    plots: Sequence[CurvePlot],
    figures: Mapping[Path, str],
    scenes: Sequence[Scene],
    path: Path,
) -> None:
    """The page. ``figures`` maps pictures on disk to what they show.

    Raises `UserError` where the page cannot be written.
    """
    facts = {
        name.replace("`", ""): value
        for name, value in (facts_of(report) | {"Settings": report.settings}).items()
    }
    write_page(
        path,
        heading,
        list(facts.items()),
        report.tables,
        plots,
        [Picture(picture.read_bytes(), caption) for picture, caption in figures.items()],
        scenes,
        {"Not a clean comparison": report.warnings, "Missing": report.missing},
        [_settings_table(report.differing)] if report.differing else [],
        {SETTINGS: report.others, TABLES: [NUMBERS]},
    )


def _settings_table(differing: Values) -> Table:
    head, *rows = settings_rows(differing)
    return Table(
        "settings",
        "What the rungs do not share",
        "Every key of their configurations in which two of them differ.",
        table_of([(name, values) for name, *values in rows], head[1:], head[0]),
    )


def learning_curves(named_runs: Sequence[tuple[str, ScoredRun]]) -> list[CurvePlot]:
    """Those of the runs that have a log. Raises `UserError` for one that cannot be read."""
    logs = [(name, log) for name, run in named_runs if (log := run.path / METRICS).is_file()]
    return [
        CurvePlot(
            title,
            unit,
            tuple(read_curve(log, column, name, 100 if unit == "%" else 1) for name, log in logs),
        )
        for column, (title, unit) in PLOTS.items()
        if logs
    ]
