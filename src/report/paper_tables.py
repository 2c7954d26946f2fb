"""The paper's tables of the ladder: each is a selection of the long table of results.

Numbers are percentages, differences percentage points. Each function leaves out the rungs that are
not there; a difference from one of these is an empty cell.
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from ..ontology import CLASSES, NUM_CLASSES
from ..results.files import SHORT_NAMES
from ..results.render import Row, Table
from ..results.table import pivoted
from .ladder import PAPER
from .run_group import BEYOND, LONG_TAIL, Part

# Names of the classes in the heads of the paper's tables.
CLASS_NAMES = {
    **dict(zip(CLASSES[:3], ("Building", "Ground", "Vegetation"))),
    **dict(zip(LONG_TAIL, ("Thin Struct.", "Large Veh.", "Car", "VRU"))),
    **dict(zip(CLASSES[7:], ("General", "Free Space"))),
}
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
    text = (
        f"{PERCENT} mIoU is averaged over {NUM_CLASSES} classes including free space; KAR-mIoU "
        "excludes free space and unknown from the mean and penalizes FP/FN in short-TTC regions."
    )
    return _of_all(part, "main", "Main results", text, [*columns, *MEANS])


def ablation_table(part: Part, marks: Mapping[str, Sequence[str]]) -> Table:
    """The paper's Table 3: which of the three factors every rung has, and what it gains."""
    changes = {"miou": "mIoU", "kar_miou": "KAR", "iou/thin_structure": "Thin", "iou/vru": "VRU"}
    columns = [*MEANS, *_changes(changes, part.ladder.first)]

    rows = _cells(part, [(name, {"experiment": name}) for name in part.rungs], columns)
    rows = [(part.ladder.row_name(name), [*marks[name], *cells]) for name, cells in rows]
    text = f"Gains are measured relative to {part.ladder.reference}. {PERCENT}"
    return _of_rungs(part, "ablation", "Ablation study", text, [*FACTORS, *columns], rows)


def long_tail_table(part: Part, frames: Collection[int]) -> Table:
    """The paper's table of thin structures, large vehicles, cars and VRUs, and the full model's
    gain."""
    columns = [Column(f"iou/{name}", CLASS_NAMES[name]) for name in LONG_TAIL]
    columns.append(Column("long_tail", "Mean"))
    rows = [(_added(part, name, frames), {"experiment": name}) for name in part.rungs]

    # The last row says what the highest rung gains over the lowest, where both are there.
    lines, first, last = (), part.ladder.first, part.ladder.last
    if {first, last} <= set(part.rungs) and first != last:
        lines = (len(rows),)
        full = "full model" if last == PAPER.last else part.ladder.row_name(last)
        rows.append((f"Gain of {full}", {"experiment": last, "reference": first}))

    text = (
        f"Gains are relative to {part.ladder.reference}. All numbers are standard IoU percentages, "
        "in brackets their intervals."
    )
    cells = _cells(part, rows, columns)
    return _of_rungs(
        part, "long_tail", "Long-tail safety structures", text, columns, cells, lines=lines
    )


def incremental_table(part: Part) -> Table:
    """The paper's table of changes, each from the rung just below."""
    changes = {"miou": "mIoU", "kar_miou": "KAR"}
    changes |= {f"iou/{name}": CLASS_NAMES[name] for name in LONG_TAIL}
    columns = _changes(changes, best="")

    # A step whose lower rung is missing has no number: that from another rung would be wrong.
    rows = [
        (
            part.ladder.rungs[name].added or part.ladder.row_name(name),
            {"experiment": name, "reference": before},
        )
        for before, name in pairwise(part.ladder.names)
        if name in part.rungs
    ]
    text = (
        "Values are percentage-point changes from the immediately previous configuration, in "
        "brackets their intervals; empty where that is missing."
    )
    title, cells = "Incremental component effects", _cells(part, rows, columns)
    return _of_rungs(part, "incremental", title, text, columns, cells, head="Added component")


def progression_table(part: Part, frames: Collection[int]) -> Table:
    """The paper's multi-frame progression, with the gap between its two means."""
    changes = _changes({"miou": "mIoU", "kar_miou": "KAR"}, part.ladder.first)
    # No best: the lowest gap is that of a model that finds nothing.
    columns = [*MEANS, *changes, Column("gap", "Gap", best="")]

    rows = [(_added(part, name, frames), {"experiment": name}) for name in part.rungs]
    text = (
        f"Δ values are relative to {part.ladder.reference}. {PERCENT} The gap is mIoU less "
        "KAR-mIoU: what leaving free space out and weighing by time to collision take together."
    )
    title, cells = f"{_kind(frames)} progression", _cells(part, rows, columns)
    return _of_rungs(part, "progression", title, text, columns, cells)


def beyond_table(part: Part) -> Table:
    """Scores that the paper does not have, and those of metrics of a user's own.

    A score that no run has, has no column.
    """
    scored = set(part.scores["score"])
    columns = [Column(score, *named) for score, named in BEYOND.items() if score in scored]
    columns += [Column(score, score) for score in part.own_scores]

    text = (
        f"{PERCENT} mIoU of the occupied classes alone; IoU of occupied against free; RayIoU of "
        "what the camera's rays meet first; of the paths that the UAV could fly next and that are "
        "blocked, the share called clear where 1 % of the clear ones are called blocked, and the "
        "area under that curve; of what truly is occupied, the share predicted free: in the tube "
        "that the UAV's body sweeps, and in the bubble within the horizon. These two rates are "
        "lowest for what calls everything occupied: read them with the IoU."
    )
    return _of_all(part, "beyond", "Beyond the paper", text, columns)


def _of_all(part: Part, key: str, title: str, text: str, columns: Sequence[Column]) -> Table:
    """Returns a table of all experiments: the ladder, the others, the anchors, lines between."""
    rows: list[Row] = []
    lines = []
    for names in (part.rungs, part.others, part.anchors):
        if names and rows:
            lines.append(len(rows))
        keys = [(part.ladder.row_name(name), {"experiment": name}) for name in names]
        rows += _cells(part, keys, columns)
    return _table(part, key, title, text, columns, rows, lines=tuple(lines))


def _of_rungs(
    part: Part,
    key: str,
    title: str,
    text: str,
    columns: Sequence[Column],
    rows: Sequence[Row],
    **more,
) -> Table:
    """Returns a table of the ladder alone."""
    return _table(part, key, title, text, columns, rows, **{"head": "Configuration", **more})


def _table(
    part: Part,
    key: str,
    title: str,
    caption: str,
    columns: Sequence[Column],
    rows: Sequence[Row],
    **more,
) -> Table:
    """Returns a table whose key and title name its part of the split."""
    suffix = "" if part.name == "test" else f"_{part.name}"
    return Table(
        f"{key}{suffix}",
        f"{title}, {part.name} of {part.dataset}",
        caption,
        [column.name for column in columns],
        rows,
        best={column.name: column.best for column in columns if column.best},
        short={column.name: column.short for column in columns if column.short},
        **more,
    )


def _cells(
    part: Part, rows: Sequence[tuple[str, Mapping[str, str]]], columns: Sequence[Column]
) -> list[Row]:
    """Returns the cells of rows; each row selects an experiment and a reference."""
    keys = [
        {"part": part.name, "score": column.score, "reference": column.reference}
        for column in columns
    ]
    return pivoted(part.scores, rows, keys)


def _changes(names: Mapping[str, str], reference: str = "", best: str = "high") -> list[Column]:
    """Returns a column for the change of each score; without a ``reference`` the row names it."""
    return [Column(score, f"Δ {name}", best, reference=reference) for score, name in names.items()]


def _kind(frames: Collection[int]) -> str:
    return "Multi-frame" if max(frames) > 1 else "Single-frame"


def _added(part: Part, name: str, frames: Collection[int]) -> str:
    """Returns a rung's name by what it adds, as the paper's appendix does."""
    if name == part.ladder.first == PAPER.first:
        return f"{_kind(frames)} baseline"
    added = part.ladder.rungs[name].added
    return f"+ {added}" if added else part.ladder.row_name(name)
