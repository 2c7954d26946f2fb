"""``report.md``: a report of the ladder as one page of text and tables."""

from collections.abc import Mapping, Sequence

from .ladder_report import LadderReport
from .scored_runs import UNKNOWN_CODE, ScoredRun
from .shared_settings import Values, shortened
from .table_files import escaped, markdown_of

NUMBERS = (
    "Numbers are percentages and differences percentage points, in the files too. In bold: the "
    "best mean of a column, whatever the intervals say."
)


def report_text(report: LadderReport, heading: str, figures: Mapping[str, str]) -> str:
    """The page: what the numbers rest on first, then the tables, then the files beside it.

    ``figures`` maps the places of pictures, beside the page, to what they show.
    """
    blocks = [
        f"# {heading}",
        "\n".join(f"- {name}: {escaped(value)}" for name, value in facts_of(report).items()),
        *_list("Not a clean comparison", report.warnings),
        *_list("Missing", report.missing),
        *_settings(report),
        "## Tables",
        NUMBERS,
        *(markdown_of(table).rstrip() for table in report.tables),
        *(["## Figures"] if figures else []),
        *(
            f"![{escaped(caption)}]({place})\n\n{escaped(caption)}"
            for place, caption in figures.items()
        ),
        *_files(report),
    ]
    return "\n\n".join(blocks) + "\n"


def facts_of(report: LadderReport) -> dict[str, str]:
    """Which runs, data and code the numbers rest on."""
    by_experiment: dict[str, list[str]] = {}
    for group in report.groups:
        for run in group.runs:
            by_experiment.setdefault(run.experiment + group.label, []).append(str(run.seed))
    runs = report.runs
    facts = {
        "Runs": [f"{name}, seed {', '.join(seeds)}" for name, seeds in by_experiment.items()],
        "Data set": [run.tally.protocol.dataset for run in runs],
        "Grid": [_grid(run) for run in runs],
        "Code (`src/`)": [run.code_digest or UNKNOWN_CODE for run in runs],
        "Commit": [run.row["git_commit"] or "none" for run in runs],
        "Precision": [run.row["precision"] for run in runs],
        "Parameters": _parameters(report),
    }
    return {name: "; ".join(dict.fromkeys(values)) for name, values in facts.items()}


def _parameters(report: LadderReport) -> list[str]:
    """The sizes of the models, and which experiments have them where there are several."""
    sizes: dict[str, dict[str, None]] = {}
    for group in report.groups:
        for run in group.runs:
            experiments = sizes.setdefault(f"{run.row['parameters']:,}", {})
            experiments[run.experiment + group.label] = None
    if len(sizes) == 1:
        return list(sizes)
    return [f"{size} ({', '.join(experiments)})" for size, experiments in sizes.items()]


def _grid(run: ScoredRun) -> str:
    grid = run.tally.protocol.voxel_grid
    return f"{' x '.join(map(str, grid.shape))} voxels of {grid.voxel_m:g} m"


def _list(heading: str, lines: Sequence[str]) -> list[str]:
    return [f"## {heading}", _listed(lines)] if lines else []


def _listed(lines: Sequence[str]) -> str:
    return "\n".join(f"- {escaped(line)}" for line in lines)


def _settings(report: LadderReport) -> list[str]:
    """What all rungs share, the values of what they do not, and what other experiments are."""
    blocks = ["## Settings", escaped(report.settings)]
    blocks += [_differing(report.differing)] if report.differing else []
    return blocks + ([_listed(report.others)] if report.others else [])


def settings_rows(values: Values) -> list[list[str]]:
    """The head of a table of settings, and a row for each of them."""
    experiments = list(next(iter(values.values())))
    return [
        ["setting", *experiments],
        *(
            [key, *(", ".join(map(shortened, of[name])) for name in experiments)]
            for key, of in values.items()
        ),
    ]


def _differing(values: Values) -> str:
    head, *rows = settings_rows(values)
    lines = [map(escaped, head), [":--"] * len(head), *(map(escaped, row) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _files(report: LadderReport) -> list[str]:
    keys = ", ".join(f"`{table.key}`" for table in report.tables)
    return [
        "## Files",
        "`report.html` is this page to look at, with sortable tables, learning curves and, where "
        "the data set and checkpoints were there, scenes in 3-D. `tables/` holds each table as "
        "`.csv` (full precision, bounds in columns of their own), `.md` and `.tex` (needs "
        f"`booktabs`): {keys}. `seeds.csv` has the scores of every run and part.",
    ]
