"""``report.html``: a report of the ladder as a page to look at."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from markupsafe import Markup

from ..results.render import Table, table_html
from ..results.runs import ScoredRun
from ..run_folder import METRICS
from .curve_plot import CurvePlot
from .curves import TRAIN_LOSS, read_curve
from .ladder_report import LadderReport
from .page import SETTINGS, TABLES, write_page
from .picture import Picture
from .report_text import NUMBERS, facts_of, settings_rows
from .scene import VoxelScene
from .shared_settings import Values

# Columns of ``metrics.csv``, and the titles and units of their plots.
PLOTS = {
    "val/kar_miou": ("KAR-mIoU on validation", "%"),
    "val/miou": ("mIoU on validation", "%"),
    TRAIN_LOSS: ("Training loss, each rung its own", ""),
}


def write_report_page(
    report: LadderReport,
    heading: str,
    plots: Sequence[CurvePlot],
    figures: Mapping[Path, str],
    scenes: Sequence[VoxelScene],
    path: Path,
) -> None:
    """Writes the page. ``figures`` maps pictures on disk to their captions.

    Raises `UserError` where the page cannot be written.
    """
    facts = facts_of(report) | {"Settings": report.settings}
    write_page(
        path,
        heading,
        [(name.replace("`", ""), value) for name, value in facts.items()],
        tables=[Markup(table_html(table)) for table in report.tables],
        curves=plots,
        sheets=[Picture(picture.read_bytes(), caption) for picture, caption in figures.items()],
        scenes=scenes,
        alarms={"Not a clean comparison": report.warnings, "Missing": report.missing},
        settings=[_settings_table(report.differing)] if report.differing else [],
        remarks={SETTINGS: report.others, TABLES: [NUMBERS]},
    )


def _settings_table(differing: Values) -> Markup:
    (corner, *columns), *rows = settings_rows(differing)
    table = Table(
        "settings",
        "What the rungs do not share",
        "Every key of their configurations in which two of them differ.",
        columns,
        [(name, values) for name, *values in rows],
        corner,
    )
    return Markup(table_html(table))


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
