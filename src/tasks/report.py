"""task=report: the paper's tables from the run folders of a ladder, with intervals."""

from itertools import product
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from ..atomic import replacing
from ..errors import UserError
from ..report.ladder_report import LadderReport, ladder_report
from ..report.ladder_tables import KEYS
from ..report.report_text import report_text
from ..report.run_group import groups_of
from ..report.scored_runs import ScoredRun, UnfinishedRun, read_run, run_folders
from ..report.scores import write_table
from ..report.table_files import ENDINGS, write_files
from ..report.table_print import print_table
from .scoring import parts_of

WIDTH = 110
PAGE, SEEDS, TABLES = "report.md", "seeds.csv", "tables"
PRINTED = ("main", "ablation")


def report(cfg: DictConfig, runs: list[str], out: str, mixed: bool) -> None:
    """Writes ``report.md``, ``seeds.csv`` and ``tables/`` to ``out``, and prints the main tables.

    Without ``runs`` it takes all of the scale. Raises `UserError` where no run is finished, a run
    cannot be read, or runs may not be put beside each other and ``mixed`` does not allow it.
    """
    folder = Path(out)
    places = [Path(place) for place in runs] or [Path(cfg.paths.runs) / cfg.scale_name]
    found = [read_run(path) for path in run_folders(places, folder)]
    finished = [run for run in found if isinstance(run, ScoredRun)]
    unfinished = [run for run in found if isinstance(run, UnfinishedRun)]
    if not finished:
        raise UserError(
            f"{', '.join(map(str, places))}: holds no finished run ("
            f"{'; '.join(map(str, unfinished))}); give the command that trains them again"
        )
    groups = groups_of(finished, mixed)
    made = ladder_report(groups, unfinished, parts_of)
    _write(made, folder, f"Report of {groups[0].runs[0].tally.protocol.dataset}")
    _print(made, folder)


def _write(made: LadderReport, folder: Path, heading: str) -> None:
    written = {path for table in made.tables for path in write_files(table, folder / TABLES)}
    # A table of an earlier report would be taken for one of this one.
    for key, part in product(KEYS, parts_of([])):
        stem = key if part == "test" else f"{key}_{part}"
        for path in {folder / TABLES / f"{stem}{ending}" for ending in ENDINGS} - written:
            path.unlink(missing_ok=True)
    write_table(made.seeds, folder / SEEDS)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(report_text(made, heading), encoding="utf-8", newline="\n")


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
