"""The paper's tables of the ladder: each is a selection of the long table of results.

Numbers are percentages, differences percentage points. Each function leaves out the rungs that are
not there; a difference from one of these is an empty cell.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..ontology import CLASSES
from ..results.files import SHORT_NAMES
from ..results.render import Table, with_recipes
from ..results.table import pivoted
from .ladder import PAPER
from .run_group import BEYOND, LONG_TAIL, Part

# Names of the classes in the heads of the paper's tables.
HEADS = ("Building", "Ground", "Vegetation", "Thin Struct.", "Large Veh.", "Car", "VRU", "General")
CLASS_NAMES = dict(zip(CLASSES, (*HEADS, "Free Space")))
PERCENT = "All numbers are percentages, in brackets their intervals."


class Column(NamedTuple):
    """A score, or its change from a ``reference``; ``best`` is the end of it that is marked."""

    score: str
    name: str
    best: str = "high"
    short: str = ""
    reference: str = ""


# The two scores that the paper ranks by; the second is its own.
MEANS = [Column("miou", "mIoU"), Column("kar_miou", "KAR-mIoU", short="KAR")]
# Columns of check marks: no score stands in them.
FACTORS = [
    Column("", "Att. Proj.", best="", short="att."),
    Column("", "Class Weight", best="", short="wts."),
    Column("", "Lovász", best="", short="lov."),
]
CHANGES = {"miou": "mIoU", "kar_miou": "KAR"}

# The name of a row, and whose scores it shows, or whose changes and from what.
Key = tuple[str, dict[str, str]]


def paper_tables(part: Part, marks: Mapping[str, Sequence[str]], frames: set[int]) -> list[Table]:
    """Returns every table of one part, without those that have no row or no column.

    ``marks`` are the factors of every rung, and ``frames`` the numbers of frames that its
    predictions see.
    """
    tables = [main_table(part), ablation_table(part, marks)]
    # The paper has these tables of the whole split alone.
    if part.name == "test" and part.rungs:
        tables += [long_tail_table(part, frames), incremental_table(part)]
        tables.append(progression_table(part, frames))

    return [table for table in (*tables, beyond_table(part)) if table.rows and table.columns]


def main_table(part: Part) -> Table:
    """The paper's Table 2: IoU of every class, mIoU and KAR-mIoU of every experiment."""
    columns = [Column(f"iou/{c}", CLASS_NAMES[c], short=SHORT_NAMES[c]) for c in CLASSES]
    text = f"{PERCENT} KAR-mIoU leaves free space out and penalizes errors at a short TTC."
    return _of_all(part, "main", "Main results", text, [*columns, *MEANS])


def ablation_table(part: Part, marks: Mapping[str, Sequence[str]]) -> Table:
    """The paper's Table 3: which of the three factors every rung has, and what it gains."""
    changes = CHANGES | {"iou/thin_structure": "Thin", "iou/vru": "VRU"}
    columns = [*FACTORS, *MEANS, *_changes(changes, part.ladder.first)]
    rows = [(part.ladder.row_name(name), {"experiment": name}) for name in part.rungs]
    text = f"Gains are measured relative to {part.ladder.reference}. {PERCENT}"
    table = _table(part, "ablation", "Ablation study", text, columns, rows)
    marked = [
        (row, [*marks[name], *cells[len(FACTORS) :]])
        for name, (row, cells) in zip(part.rungs, table.rows)
    ]
    return replace(table, rows=marked)


def long_tail_table(part: Part, frames: Collection[int]) -> Table:
    """The paper's table of thin structures, large vehicles, cars and VRUs, and the full model's
    gain."""
    columns = [Column(f"iou/{name}", CLASS_NAMES[name]) for name in LONG_TAIL]
    columns.append(Column("long_tail", "Mean"))
    rows, lines = _by_added(part, frames), ()

    # The last row says what the highest rung gains over the lowest, where both are there.
    first, last = part.ladder.first, part.ladder.names[-1]
    if {first, last} <= set(part.rungs) and first != last:
        lines = (len(rows),)
        full = "full model" if last == PAPER.names[-1] else part.ladder.row_name(last)
        rows.append((f"Gain of {full}", {"experiment": last, "reference": first}))
    text = f"Gains are relative to {part.ladder.reference}. {PERCENT}"
    return _table(part, "long_tail", "Long-tail safety structures", text, columns, rows, lines)


def incremental_table(part: Part) -> Table:
    """The paper's table of changes, each from the rung just below."""
    changes = CHANGES | {f"iou/{name}": CLASS_NAMES[name] for name in LONG_TAIL}
    # A step whose lower rung is missing has no number: that from another rung would be wrong.
    rows = [
        (rung.added or part.ladder.row_name(name), {"experiment": name, "reference": before})
        for before, (name, rung) in zip(part.ladder.names, [*part.ladder.rungs.items()][1:])
        if name in part.rungs
    ]
    text = f"Changes are from the configuration before, where that is there. {PERCENT}"
    title, columns = "Incremental component effects", _changes(changes, best="")
    return _table(part, "incremental", title, text, columns, rows, head="Added component")


def progression_table(part: Part, frames: Collection[int]) -> Table:
    """The paper's multi-frame progression, with the gap between its two means."""
    # No best: the lowest gap is that of a model that finds nothing.
    columns = [*MEANS, *_changes(CHANGES, part.ladder.first), Column("gap", "Gap", best="")]
    text = f"Δ is relative to {part.ladder.reference}, the gap mIoU less KAR-mIoU. {PERCENT}"
    title, rows = f"{_kind(frames)} progression", _by_added(part, frames)
    return _table(part, "progression", title, text, columns, rows)


def beyond_table(part: Part) -> Table:
    """Scores that the paper does not have, and those of metrics of a user's own.

    A score that no run has, has no column.
    """
    scored = set(part.scores["score"])
    columns = [Column(score, *named) for score, named in BEYOND.items() if score in scored]
    columns += [Column(score, score, best="") for score in part.own_scores]
    text = (
        f"{PERCENT} docs/metrics.md describes them. The collision-miss rate and the false-free "
        "rate are lowest for what calls everything occupied: read them with the IoU."
    )
    return _of_all(part, "beyond", "Beyond the paper", text, columns)


def _of_all(part: Part, key: str, title: str, text: str, columns: Sequence[Column]) -> Table:
    """Returns a table of all experiments: the ladder, the others, the anchors, lines between."""
    rows: list[Key] = []
    lines = []
    for names in part.groups:
        if names and rows:
            lines.append(len(rows))
        rows += [(part.ladder.row_name(name), {"experiment": name}) for name in names]
    return _table(part, key, title, text, columns, rows, tuple(lines), head="Method")


def _table(
    part: Part,
    key: str,
    title: str,
    caption: str,
    columns: Sequence[Column],
    rows: Sequence[Key],
    lines: tuple[int, ...] = (),
    head: str = "Configuration",
) -> Table:
    """Returns a table whose key and title name its part of the split."""
    keys = [{"part": part.name, "score": c.score, "reference": c.reference} for c in columns]

    table = Table(
        key if part.name == "test" else f"{key}_{part.name}",
        f"{title}, {part.name} of {part.resamples.first.protocol.dataset}",
        caption,
        [column.name for column in columns],
        pivoted(part.scores, rows, keys),
        head,
        best={column.name: column.best for column in columns if column.best},
        short={column.name: column.short for column in columns if column.short},
        lines=lines,
    )
    return with_recipes(table, [part.resamples.recipes[row["experiment"]] for _, row in rows])


def _changes(names: Mapping[str, str], reference: str = "", best: str = "high") -> list[Column]:
    """Returns a column for the change of each score; from what, the rows say where it does not."""
    return [Column(score, f"Δ {name}", best, reference=reference) for score, name in names.items()]


def _kind(frames: Collection[int]) -> str:
    return "Multi-frame" if max(frames) > 1 else "Single-frame"


def _by_added(part: Part, frames: Collection[int]) -> list[Key]:
    """Returns a row a rung, named by what it adds, as the paper's appendix does."""
    rows = []
    for name in part.rungs:
        added = part.ladder.rungs[name].added
        row = f"+ {added}" if added else part.ladder.row_name(name)
        if name == part.ladder.first == PAPER.first:
            row = f"{_kind(frames)} baseline"
        rows.append((row, {"experiment": name}))
    return rows
