"""``report.md``: a report of the ladder as one page of tables."""

from collections.abc import Mapping

from ..results.render import markdown, markdown_of
from .ladder_report import LadderReport

# Stands before the tables, in the page and in the text.
NUMBERS = (
    "Numbers are percentages and differences percentage points, but shares in `scores.csv`. In "
    "bold: the best mean of a column, whatever the intervals say. What the "
    "intervals rest on has a table of its own."
)
FILES = """\
| file | what |
| :-- | :-- |
| `report.html` | this page to look at, with learning curves and scenes in 3-D |
| `tables.tex` | all tables in LaTeX (needs `booktabs`) |
| `tables.csv` | their numbers in full precision |
| `scores.csv` | the long table: every score of every run, condition and part |"""


def report_text(report: LadderReport, heading: str, figures: Mapping[str, str]) -> str:
    """Returns the page: what the numbers rest on first, then the tables, then the files beside it.

    ``figures`` maps the places of pictures, beside the page, to what they show.
    """
    missing = "\n".join(f"- {markdown(line)}" for line in report.missing)
    pictures = [
        f"![{markdown(caption)}]({place})\n\n{markdown(caption)}"
        for place, caption in figures.items()
    ]

    # What makes the numbers doubtful stands before the numbers.
    blocks = [
        f"# {heading}",
        *([markdown_of(report.unclean)] if report.unclean.rows else []),
        *(["## Missing", missing] if missing else []),
        "## Facts",
        *map(markdown_of, report.facts),
        "## Tables",
        NUMBERS,
        *map(markdown_of, report.tables),
        *(["## Figures", *pictures] if pictures else []),
        "## Files",
        FILES,
    ]
    return "\n\n".join(block.rstrip() for block in blocks) + "\n"
