"""``report.md``: a report of the ladder as one page of text and tables."""

from collections.abc import Iterable, Mapping, Sequence

from ..results.render import markdown, markdown_of
from ..results.runs import UNKNOWN_CODE, ScoredRun
from .ladder_report import LadderReport
from .shared_settings import Values, grouped, listed, shortened

# Stands before the tables, in the page and in the text.
NUMBERS = (
    "Numbers are percentages and differences percentage points, but shares in `scores.csv`. In "
    "bold: the best mean of a column, whatever the intervals say."
)
FILES = (
    "`report.html` is this page to look at, with learning curves and, where the "
    "dataset and checkpoints were there, scenes in 3-D. `tables.tex` has all tables in LaTeX "
    "(needs `booktabs`), and `tables.csv` their numbers in full precision. `scores.csv` is the "
    "long table that they are made of: every score of every run, condition and part."
)


def report_text(report: LadderReport, heading: str, figures: Mapping[str, str]) -> str:
    """Returns the page: what the numbers rest on first, then the tables, then the files beside it.

    ``figures`` maps the places of pictures, beside the page, to what they show.
    """
    facts = (f"- {name}: {markdown(value)}" for name, value in facts_of(report).items())
    pictures = [
        f"![{markdown(caption)}]({place})\n\n{markdown(caption)}"
        for place, caption in figures.items()
    ]

    # What makes the numbers doubtful stands before the numbers.
    blocks = [
        f"# {heading}",
        "\n".join(facts),
        *(["## Not a clean comparison", _bullets(report.warnings)] if report.warnings else []),
        *(["## Missing", _bullets(report.missing)] if report.missing else []),
        "## Settings",
        markdown(report.settings),
        *([_differing(report.differing)] if report.differing else []),
        *([_bullets(report.others)] if report.others else []),
        "## Tables",
        NUMBERS,
        *(markdown_of(table).rstrip() for table in report.tables),
        *(["## Figures", *pictures] if pictures else []),
        "## Files",
        FILES,
    ]
    return "\n\n".join(blocks) + "\n"


def facts_of(report: LadderReport) -> dict[str, str]:
    """Returns the runs, data and code that the numbers rest on, by what each of them is."""
    runs = report.runs
    seeds = _by_experiment(report, lambda run: str(run.seed))
    numbers = _by_experiment(report, lambda run: f"{run.row['parameters']:,}")
    sizes = grouped((size, name) for name, size in numbers.items())

    facts = {
        "Runs": [f"{name}, seed {of_one}" for name, of_one in seeds.items()],
        "Dataset": [run.counts.protocol.dataset for run in runs],
        "Grid": [_grid(run) for run in runs],
        "Code (`src/`)": [run.code_digest or UNKNOWN_CODE for run in runs],
        "Commit": [run.row["git_commit"] or "none" for run in runs],
        "Precision": [run.row["precision"] for run in runs],
        # One size needs no names: it is that of every experiment.
        "Parameters": [listed(sizes)] if len(sizes) > 1 else list(sizes),
    }
    return {name: "; ".join(dict.fromkeys(values)) for name, values in facts.items()}


def settings_rows(values: Values) -> list[list[str]]:
    """Returns the head of a table of settings, and a row for each of them."""
    experiments = list(next(iter(values.values())))
    rows = [
        [key, *(", ".join(map(shortened, of[name])) for name in experiments)]
        for key, of in values.items()
    ]
    return [["setting", *experiments], *rows]


def _by_experiment(report: LadderReport, fact) -> dict[str, str]:
    """Returns a fact of each experiment: its values in all runs, each once."""
    facts = grouped((run.experiment, fact(run)) for run in report.runs)
    return {name: ", ".join(values) for name, values in facts.items()}


def _grid(run: ScoredRun) -> str:
    grid = run.counts.protocol.voxel_grid
    return f"{' x '.join(map(str, grid.shape))} voxels of {grid.voxel_m:g} m"


def _bullets(lines: Sequence[str]) -> str:
    return "\n".join(f"- {markdown(line)}" for line in lines)


def _differing(values: Values) -> str:
    head, *rows = ([markdown(text) for text in row] for row in settings_rows(values))
    lines: Iterable[list[str]] = (head, [":--"] * len(head), *rows)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
