"""The short table that ends a command which scores: the main numbers, and where the others are."""

from pathlib import Path

from rich.console import Console

from ..run_folder import ANCHORS, TALLIES
from ..run_folder import SCORES as LONG
from ..terminal import say
from .counts import Counts
from .files import read_scores
from .render import Cell, Row, Table, print_table, with_recipes

# Scores of the table, what heads them, and which end of them is the better one.
COLUMNS = {
    "miou": ("mIoU", "high"),
    "miou_occupied": ("mIoU occupied", "high"),
    "kar_miou": ("KAR-mIoU", "high"),
    "geometric_iou": ("geometric IoU", "high"),
    "primitive_miss": ("primitive miss", "low"),
}
WIDTH = 100
EXPLAINED = (
    "* the best of a column. mIoU has free space in it, mIoU occupied and KAR-mIoU have not. "
    "Primitive miss: blocked paths called clear, at 1 % false alarms; less is better."
)


def print_summary(folder: Path, name: str, then: str, console: Console | None = None) -> None:
    """Prints the main scores of an experiment and of the anchors beside it, and where to go on.

    ``folder`` is one that `write_scores` has filled, ``then`` the next command, if there is one.
    Raises `UserError` where a file of the folder cannot be read.
    """
    print_table(summary_of(folder, name), console or Console(width=WIDTH))
    say(EXPLAINED)
    next_one = f". Next: {then}" if then else ""
    say(f"Every class and score, with intervals: {folder / LONG}{next_one}")


def summary_of(folder: Path, name: str) -> Table:
    """Returns a table of all experiments on the whole split, and below of this one on its parts.

    Scores of metrics of one's own have columns, too.
    """
    own = Counts.read(folder / TALLIES / f"{name}.npz").own_scores
    columns = COLUMNS | {score: (score, "") for score in own}
    scores = read_scores(folder / LONG)
    values = scores.set_index(["experiment", "part", "score"])["value"].to_dict()
    recipes = dict(zip(scores["experiment"], scores["recipe"]))

    def row(title: str, experiment: str, part: str) -> Row:
        found = [values.get((experiment, part, score)) for score in columns]
        return title, [None if value is None else Cell(100 * value) for value in found]

    whole, *parts = scores["part"].unique()
    experiments = [each for each in (name, *reversed(ANCHORS)) if each in recipes]
    rows = [row(each, each, whole) for each in experiments]
    for part in parts:
        rows.append(
            row(f"{name}, {part.removeprefix(whole).replace('_', ' ').strip()}", name, part)
        )

    table = Table(
        "summary",
        f"Scores, {whole} (%)",
        "",
        [head for head, _ in columns.values()],
        rows,
        "",
        best={head: end for head, end in columns.values() if end},
        lines=(len(experiments),),
        ranked=len(experiments),
    )
    return with_recipes(
        table, [*(recipes[each] for each in experiments), *(recipes[name] for _ in parts)]
    )
