"""task=report: the paper's tables and pictures from the run folders of a ladder."""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from ..atomic import replacing
from ..errors import UserError
from ..failures import closest
from ..metrics.suite import import_metrics
from ..report.attitude import SCORE, draw_attitude
from ..report.attitude_evidence import AttitudeEvidence
from ..report.attitude_tables import attitude_tables
from ..report.curve_plot import CurvePlot
from ..report.ladder import Ladder, ladder_named
from ..report.ladder_report import LadderReport, ladder_report
from ..report.ladder_tables import KEYS
from ..report.published_runs import publish_runs
from ..report.report_page import learning_curves, write_report_page
from ..report.report_text import report_text
from ..report.run_group import groups_of
from ..report.scene import VoxelScene
from ..report.scored_runs import ScoredRun, UnfinishedRun, read_run, run_folders
from ..report.scores import write_table
from ..report.table_files import ENDINGS, write_files
from ..report.table_print import print_table
from ..settings import GROUPS
from ..terminal import tracked
from .scoring import parts_of
from .showcase import COMPARISON, TILT, showcase

WIDTH = 110
TEXT, PAGE, SEEDS, TABLES, FIGURES = "report.md", "report.html", "seeds.csv", "tables", "figures"
RUNS = "runs"
ATTITUDE_FIGURE = "attitude.png"
PRINTED = ("main", "ablation")


def report(
    cfg: DictConfig,
    runs: Sequence[str],
    out: str,
    mixed: bool,
    scenes: int,
    rungs: Sequence[str] = (),
    seeds: Sequence[int] = (),
    publish: bool = False,
) -> None:
    """Writes the tables, figures and pages of `_write` to ``out``, and prints the main tables.

    Without ``runs`` it takes all of the scale, and without ``rungs`` the ladder is the paper's;
    runs of ``seeds`` that are not there are named as missing. With ``publish`` it leaves what the
    tables are made from as well (`publish_runs`). Of so many ``scenes`` it shows what the lowest
    and the highest rung predict, where the data set and their checkpoints are there. Raises
    `UserError` where no run is finished, a run cannot be read, or runs may not be put beside each
    other and ``mixed`` does not allow it.
    """
    import_metrics(cfg.suite)
    folder, ladder = Path(out), ladder_named(list(rungs))
    _require_place(folder)
    if strange := [seed for seed in seeds if type(seed) is not int]:
        raise UserError(f"task.seeds: {strange[0]!r} is no seed; give whole numbers")
    finished, unfinished = _found(cfg, runs, folder)
    _require_experiments(rungs, {run.experiment for run in (*finished, *unfinished)})
    groups = groups_of(finished, mixed, ladder)
    with Console().status("resampling"):
        made = ladder_report(groups, unfinished, parts_of, list(seeds))
        attitude = AttitudeEvidence(groups[0].runs)
    plots = learning_curves(made.named_runs)
    shown = showcase(cfg, groups[0].runs, folder / FIGURES, scenes, ladder)
    tables = (*made.tables, *attitude_tables(attitude, ladder))
    made = replace(made, tables=tables, missing=(*made.missing, *shown.missing))
    figures = shown.figures | _attitude_figure(attitude, ladder, folder / FIGURES)
    _write(made, plots, figures, shown.scenes, folder)
    if publish:
        publish_runs(made.groups, folder / RUNS)
    _print(made, folder)


def _found(
    cfg: DictConfig, runs: Sequence[str], folder: Path
) -> tuple[list[ScoredRun], list[UnfinishedRun]]:
    """The finished runs, of which there must be one, and the others."""
    places = [Path(str(place)) for place in runs] or [Path(cfg.paths.runs) / cfg.scale_name]
    found = [read_run(path) for path in tracked(run_folders(places, folder), "reading")]
    finished = [run for run in found if isinstance(run, ScoredRun)]
    unfinished = [run for run in found if isinstance(run, UnfinishedRun)]
    if not finished:
        raise UserError(
            f"{', '.join(map(str, places))}: holds no finished run ("
            f"{'; '.join(map(str, unfinished))}); give the command that trains them again"
        )
    return finished, unfinished


def _require_place(folder: Path) -> None:
    """Raises `UserError` where the report cannot be written; makes nothing."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise UserError(f"task.out: {there} is no folder; choose another place")
    if not os.access(there, os.W_OK):
        raise UserError(f"task.out: {there} cannot be written to; choose another place")


def _require_experiments(rungs: Sequence[str], trained: Collection[str]) -> None:
    """Raises `UserError` for a rung that was never trained and that no file describes."""
    known = {*trained, *(path.stem for path in (GROUPS / "experiment").glob("*.yaml"))}
    for name in rungs:
        if name not in known:
            listed = ", ".join(sorted(known))
            raise UserError(
                f"task.rungs: no run and no experiment is called {name!r}{closest(name, known)} "
                f"there are {listed}"
            )


def _attitude_figure(found: AttitudeEvidence, ladder: Ladder, folder: Path) -> dict[Path, str]:
    """The picture of what attitude does, and what it shows; none where nothing was scored."""
    names, first = ladder.in_order(found.experiments), ladder.first
    if not names:
        return {}
    tables = {ladder.row_name(name): found.table(SCORE, name) for name in names}
    above = [name for name in names if first in names and name != first]
    gains = {ladder.row_name(name): found.table(SCORE, name, first) for name in above}
    # Of rungs that have no seed in common there is no difference.
    gains = {name: table for name, table in gains.items() if len(table)}
    worths = {ladder.row_name(name): found.worths(SCORE, name) for name in names}
    worths = {name: table for name, table in worths.items() if len(table)}
    path = folder / ATTITUDE_FIGURE
    draw_attitude(tables, path, gains, ladder.reference, worths)
    caption = (
        f"KAR-mIoU by tilt, what it gains over {ladder.reference}, and what the true attitude "
        "gains over being told that the UAV flies level; below, under a wrongly measured attitude. "
        "Bars are intervals, as in the tables."
    )
    return {path: caption}


def _write(
    made: LadderReport,
    plots: Sequence[CurvePlot],
    figures: Mapping[Path, str],
    scenes: Sequence[VoxelScene],
    folder: Path,
) -> None:
    """``report.md``, ``report.html``, ``seeds.csv`` and ``tables/``; the figures are there."""
    heading = f"Report of {made.runs[0].tally.protocol.dataset}"
    written = {path for table in made.tables for path in write_files(table, folder / TABLES)}
    # What is of an earlier report would be taken for a part of this one.
    for name in {COMPARISON, TILT, ATTITUDE_FIGURE} - {path.name for path in figures}:
        (folder / FIGURES / name).unlink(missing_ok=True)
    for key, part in product(KEYS, parts_of([])):
        stem = key if part == "test" else f"{key}_{part}"
        for path in {folder / TABLES / f"{stem}{ending}" for ending in ENDINGS} - written:
            path.unlink(missing_ok=True)
    write_table(made.seeds, folder / SEEDS)
    beside = {f"{FIGURES}/{path.name}": caption for path, caption in figures.items()}
    with replacing(folder / TEXT) as temporary:
        temporary.write_text(report_text(made, heading, beside), encoding="utf-8", newline="\n")
    write_report_page(made, heading, plots, figures, scenes, folder / PAGE)


def _print(made: LadderReport, folder: Path) -> None:
    console = Console(width=WIDTH)
    for key in PRINTED:
        if table := made.table(key):
            print_table(table, console)
    for lines, style in ((made.warnings, "bold red"), (made.missing, "yellow"), (made.others, "")):
        for line in lines:
            console.print(line, style=style, markup=False, highlight=False)
    console.print(made.settings, markup=False, highlight=False)
    console.print(str(folder), highlight=False, soft_wrap=True)
