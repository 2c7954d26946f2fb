"""task=report: the paper's tables and pictures from the run folders of a ladder."""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from ..errors import UserError, closest
from ..metrics.suite import import_metrics
from ..report.ladder import ladder_named
from ..report.ladder_report import LadderReport, ladder_report
from ..report.report_page import PAGE, learning_curves, write_report_pages
from ..report.run_group import group_of
from ..report.section import Section, ShownFrame, with_settings
from ..report.template import write_text
from ..results.counts import parts_of
from ..results.files import write_table
from ..results.latex import latex_of
from ..results.render import WIDTH, csv_of, print_table
from ..results.runs import ScoredRun, UnfinishedRun, read_run, run_folders
from ..settings import GROUPS
from ..terminal import tracked
from .showcase import COMPARISON, showcase

FIGURES = "figures"
SCORES, TABLES, LATEX = "scores.csv", "tables.csv", "tables.tex"
# Tables that are printed, by their keys.
PRINTED = ("main", "ablation")


def report(
    cfg: DictConfig,
    runs: Sequence[str],
    out: str,
    scenes: int,
    rungs: Sequence[str] = (),
    seeds: Sequence[int] = (),
    sections: Mapping[str, Callable[..., Section]] | None = None,
    **of_sections: object,
) -> None:
    """Writes the tables, figures and pages of `_write` to ``out``, and prints the main tables.

    Without ``runs`` it takes all of the scale and the recipe, and without ``rungs`` the ladder is
    the paper's; runs of ``seeds`` that are not there are named as missing. Each of the ``sections``
    adds its tables and pictures, and reads those of the further settings that it names. Of so many
    ``scenes`` it shows what the lowest and the highest rung predict, where the dataset and their
    checkpoints are there. Raises `UserError` where no run is finished, a run cannot be read, or
    runs may not be put beside each other.
    """
    import_metrics(cfg.suite)
    folder, ladder = Path(out), ladder_named(list(rungs))
    _require_place(folder)
    if strange := [seed for seed in seeds if type(seed) is not int]:
        raise UserError(f"task.seeds: {strange[0]!r} is no seed; give whole numbers")
    places = [Path(str(place)) for place in runs] or [Path(cfg.paths.runs) / cfg.group]
    added = with_settings(sections or {}, of_sections)

    finished, unfinished = _read(places, folder)
    _require_experiments(rungs, {run.experiment for run in (*finished, *unfinished)})
    group = group_of(finished, ladder)
    with Console().status("resampling"):
        made = ladder_report(group, unfinished, parts_of, folder, list(seeds), added)
    curves = learning_curves(group)
    shown = showcase(cfg, group.runs, folder / FIGURES, scenes, ladder)
    made = replace(made, missing=(*made.missing, *shown.missing))

    figures = shown.figures | _drawn(made, folder / FIGURES, shown.frames)
    _write(made, figures, folder)
    write_report_pages(made, curves, figures, [each.scene for each in shown.frames], folder)
    _print(made, folder)


def _read(places: Sequence[Path], out: Path) -> tuple[list[ScoredRun], list[UnfinishedRun]]:
    """Reads the finished runs, of which there must be one, and the others."""
    runs = [read_run(path) for path in tracked(run_folders(places, out), "reading")]
    finished = [run for run in runs if isinstance(run, ScoredRun)]
    unfinished = [run for run in runs if isinstance(run, UnfinishedRun)]
    if not finished:
        raise UserError(
            f"{', '.join(map(str, places))}: holds no finished run ("
            f"{'; '.join(map(str, unfinished))}); give the command that trains them again"
        )
    return finished, unfinished


def _require_place(folder: Path) -> None:
    """Raises `UserError` where the report cannot be written; makes nothing."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise UserError(f"task.out: {existing} is no folder; choose another place")
    if not os.access(existing, os.W_OK):
        raise UserError(f"task.out: {existing} cannot be written to; choose another place")


def _require_experiments(rungs: Sequence[str], trained: Collection[str]) -> None:
    """Raises `UserError` for a rung that was never trained and that no file describes."""
    known = {*trained, *(path.stem for path in (GROUPS / "experiment").glob("*.yaml"))}
    for name in rungs:
        if name not in known:
            raise UserError(
                f"task.rungs: no run and no experiment is called {name!r}"
                f"{closest(name, known)} "
                f"there are {', '.join(sorted(known))}"
            )


def _drawn(made: LadderReport, folder: Path, frames: Sequence[ShownFrame]) -> dict[Path, str]:
    """Draws the pictures of the sections, and returns the captions of those that there are."""
    captions = {folder / name: draw(folder / name, frames) for name, draw in made.pictures.items()}
    return {path: caption for path, caption in captions.items() if caption}


def _write(made: LadderReport, figures: Mapping[Path, str], folder: Path) -> None:
    """Writes the long table and the tables of the report; the figures are there."""
    # A figure of an earlier report would be taken for a part of this one.
    for name in {COMPARISON, *made.pictures} - {path.name for path in figures}:
        (folder / FIGURES / name).unlink(missing_ok=True)

    write_table(made.scores, folder / SCORES)
    write_text(folder / TABLES, csv_of(made.tables))
    write_text(folder / LATEX, "\n".join(map(latex_of, made.tables)))


def _print(made: LadderReport, folder: Path) -> None:
    """Prints the main tables, what is wrong or missing, and where the report lies."""
    console = Console(width=WIDTH)
    for table in made.tables:
        if table.key in PRINTED:
            title = f"{table.title} (%; below each number its interval)"
            print_table(replace(table, title=title), console)
    for setting, values in made.unclean.rows:
        of = "; ".join(map(" ".join, zip(made.unclean.columns, values)))
        line = f"{made.unclean.title}: {setting} ({of})"
        console.print(line, style="bold red", markup=False, highlight=False)
    for line in made.missing:
        console.print(line, style="yellow", markup=False, highlight=False)
    console.print(f"open {folder / PAGE}", highlight=False, soft_wrap=True)
