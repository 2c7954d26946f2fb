"""The paper's tables of the ladder, made from what was scored: a function a table.

Numbers are percentages, differences percentage points. Each function leaves out the rungs that are
not there; a difference from one of these is an empty cell.
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

from ..ontology import CLASSES, NUM_CLASSES
from .evidence import LONG_TAIL
from .ladder import PAPER
from .report_table import Cell, Column, ReportTable
from .results import SHORT_NAMES
from .scored_part import ScoredPart

CLASS_NAMES = {
    **dict(zip(CLASSES[:3], ("Building", "Ground", "Vegetation"))),
    **dict(zip(LONG_TAIL, ("Thin Struct.", "Large Veh.", "Car", "VRU"))),
    **dict(zip(CLASSES[7:], ("General", "Free Space"))),
}
BEYOND = {
    "miou_occupied": ("mIoU occupied", "high"),
    "geometric_iou": ("Geometric IoU", "high"),
    "ray_iou": ("RayIoU", "high"),
    "collision_miss_rate": ("Collision-miss rate", "low"),
    "false_free_rate": ("False-free rate", "low"),
}
"""Scores that the paper does not have, and which end of them is the better one."""

KEYS = (
    *("main", "ablation", "long_tail", "incremental", "progression", "beyond"),
    *("attitude_tilt", "attitude_level", "attitude_faults"),
)
"""Of the tables of the whole test split; those of its parts have the part's name after it."""

DELTA = "delta_"
"""Begins the keys of columns of differences."""


def main_table(parts: Sequence[ScoredPart]) -> ReportTable:
    """The paper's Table 2: IoU of every class, mIoU and KAR-mIoU of every experiment."""
    columns = [_score(f"iou/{name}", CLASS_NAMES[name], SHORT_NAMES[name]) for name in CLASSES]
    text = (
        f"All numbers are percentages. mIoU is averaged over {NUM_CLASSES} classes including free "
        "space; KAR-mIoU excludes free space and unknown from the mean and penalizes FP/FN in "
        "short-TTC regions."
    )
    return _of_all(parts, "main", "Main results", text, [*columns, *_means()])


def beyond_table(parts: Sequence[ScoredPart]) -> ReportTable:
    """Beyond the paper: what free space does not lift, and what a flight would meet. A score that
    no run has, has no column."""
    columns = [
        Column(score, name, best=best)
        for score, (name, best) in BEYOND.items()
        if any(part.evidence.has(score) for part in parts)
    ]
    text = (
        "All numbers are percentages. mIoU of the occupied classes alone; IoU of occupied against "
        "free; RayIoU of what the camera's rays meet first; of what truly is occupied, the share "
        "predicted free: in the tube that the UAV's body sweeps, and in the bubble within the "
        "horizon. The two rates are the better the lower, and lowest for what calls everything "
        "occupied: read them with the IoU."
    )
    frames, clips = parts[0].evidence.blocked
    if frames:
        text += (
            f" The collision-miss rate rests on the {_counted(frames, 'frame')}, of "
            f"{_counted(clips, 'clip')}, with something in the tube."
        )
    return _of_all(parts, "beyond", "Beyond the paper", text, columns)


def ablation_table(part: ScoredPart, marks: Mapping[str, Sequence[str]]) -> ReportTable:
    """The paper's Table 3; ``marks`` says of every rung which of the three factors it has."""
    factors = [
        Column("projection", "Att. Proj.", short="att."),
        Column("class_weights", "Class Weight", short="wts."),
        Column("lovasz", "Lovász", short="lov."),
    ]
    changes = {"miou": "mIoU", "kar_miou": "KAR", "iou/thin_structure": "Thin", "iou/vru": "VRU"}
    columns = [*_means(), *(_change(*change, best="high") for change in changes.items())]
    rows = [
        (part.ladder.row_name(name), (*marks[name], *_cells(part, name, columns)))
        for name in part.rungs
    ]
    text = f"Gains are measured relative to {part.ladder.reference}. All numbers are percentages."
    return _of_rungs(part, "ablation", "Ablation study", text, [*factors, *columns], rows)


def long_tail_table(part: ScoredPart, frames: Collection[int]) -> ReportTable:
    """The paper's table of thin structures, large vehicles, cars and VRUs, and what the full model
    gains."""
    columns = [_score(f"iou/{name}", CLASS_NAMES[name]) for name in LONG_TAIL]
    columns.append(_score("long_tail", "Mean"))
    rows = [(_added(part, name, frames), _cells(part, name, columns)) for name in part.rungs]
    text, lines, first, last = "", [], part.ladder.first, part.ladder.last
    if {first, last} <= set(part.rungs) and first != last:
        lines = [len(rows)]
        gain = tuple(part.evidence.difference(last, first, column.key) for column in columns)
        full = "full model" if last == PAPER.last else part.ladder.row_name(last)
        rows.append((f"Gain of {full}", gain))
        text = f"Gains are relative to {part.ladder.reference}. "
    labelled = part.evidence.labelled_clips
    clips = ", ".join(f"{CLASS_NAMES[name]} {labelled[name]}" for name in LONG_TAIL)
    text += (
        "All numbers are standard IoU percentages. Of the "
        f"{_counted(part.evidence.clips, 'clip')}, so many have a labelled voxel of the class: "
        f"{clips}."
    )
    return _of_rungs(part, "long_tail", "Long-tail safety structures", text, columns, rows, lines)


def incremental_table(part: ScoredPart) -> ReportTable:
    """The paper's table of changes, each from the rung just below."""
    changes = {"miou": "mIoU", "kar_miou": "KAR"}
    changes |= {f"iou/{name}": CLASS_NAMES[name] for name in LONG_TAIL}
    columns = [_change(*change) for change in changes.items()]
    rows = [
        (_component(part, name), _cells(part, name, columns, before))
        for before, name in pairwise(part.ladder.names)
        if name in part.rungs
    ]
    text = (
        "Values are percentage-point changes from the immediately previous configuration; empty "
        "where that is missing."
    )
    table = ("incremental", "Incremental component effects", text)
    return _of_rungs(part, *table, columns, rows, head="Added component")


def progression_table(part: ScoredPart, frames: Collection[int]) -> ReportTable:
    """The paper's multi-frame progression, with the gap between its two means; ``frames`` are the
    numbers of frames that predictions see, which is one number for the paper's rungs."""
    changes = {"miou": "mIoU", "kar_miou": "KAR"}
    columns = [*_means(), *(_change(*change, best="high") for change in changes.items())]
    # No best: the lowest gap is that of a model that finds nothing.
    columns.append(Column("gap", "Gap"))
    rows = [(_added(part, name, frames), _cells(part, name, columns)) for name in part.rungs]
    text = (
        f"Each prediction sees {_either(frames)} frame{'s' * (max(frames) > 1)}. Δ values are "
        f"relative to {part.ladder.reference}. All numbers are percentages. The gap is mIoU less "
        "KAR-mIoU: what leaving free space out and weighing by time to collision take together."
    )
    return _of_rungs(part, "progression", f"{_kind(frames)} progression", text, columns, rows)


def _of_all(
    parts: Sequence[ScoredPart], key: str, title: str, text: str, columns: Sequence[Column]
) -> ReportTable:
    """A table of all experiments: the ladder, the others, the anchors, with lines between."""
    rows, lines, first = [], [], parts[0]
    for part in parts:
        for names in (part.rungs, part.others, part.anchors):
            lines += [len(rows)] * bool(names and rows)
            rows += [
                (part.ladder.row_name(name) + part.label, _cells(part, name, columns))
                for name in names
            ]
    text += _absent(first)
    said = [f"{part.label} {part.resampling(part.rungs + part.others)}".strip() for part in parts]
    ranked = len(first.rungs + first.others + first.anchors)
    return ReportTable(
        f"{key}{first.suffix}",
        f"{title}, {first.where}",
        " ".join([text, *said]),
        tuple(columns),
        tuple(rows),
        lines=tuple(lines),
        ranked=ranked,
    )


def _of_rungs(
    part: ScoredPart,
    key: str,
    title: str,
    text: str,
    columns: Sequence[Column],
    rows: Sequence[tuple[str, tuple]],
    lines: Sequence[int] = (),
    head: str = "Configuration",
) -> ReportTable:
    caption = f"{text}{_absent(part)} {part.resampling(part.rungs, differences=True)}"
    key, title = f"{key}{part.suffix}", f"{title}, {part.where}"
    return ReportTable(key, title, caption, tuple(columns), tuple(rows), head, tuple(lines))


def _absent(part: ScoredPart) -> str:
    """What a class that is nowhere does to the means, and to their differences."""
    labelled = part.evidence.labelled_clips
    absent = [CLASS_NAMES[name] for name in CLASSES if not labelled[name]]
    if not absent:
        return ""
    return (
        f" Not one voxel is labelled {', '.join(absent)}: the class counts in a row's means, with "
        "0, if it was predicted there, and is left out if it was not."
    )


def _cells(
    part: ScoredPart, name: str, columns: Sequence[Column], reference: str | None = None
) -> tuple[Cell | None, ...]:
    """A row: scores, and where a column says so their differences from a reference, the lowest
    rung without one."""
    reference = reference or part.ladder.first
    return tuple(
        part.evidence.difference(name, reference, column.key.removeprefix(DELTA))
        if column.signed
        else part.evidence.cell(name, column.key)
        for column in columns
    )


def _means() -> list[Column]:
    return [_score("miou", "mIoU"), _score("kar_miou", "KAR-mIoU", "KAR")]


def _score(key: str, name: str, short: str = "") -> Column:
    return Column(key, name, best="high", short=short)


def _change(score: str, name: str, best: str | None = None) -> Column:
    return Column(DELTA + score, f"Δ {name}", signed=True, best=best)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _either(numbers: Collection[int]) -> str:
    return " or ".join(map(str, sorted(numbers)))


def _kind(frames: Collection[int]) -> str:
    return "Multi-frame" if max(frames) > 1 else "Single-frame"


def _added(part: ScoredPart, name: str, frames: Collection[int]) -> str:
    """A rung by what it adds, as the paper's appendix names them."""
    if name == part.ladder.first == PAPER.first:
        return f"{_kind(frames)} baseline"
    added = part.ladder.rungs[name].added
    return f"+ {added}" if added else part.ladder.row_name(name)


def _component(part: ScoredPart, name: str) -> str:
    return part.ladder.rungs[name].added or part.ladder.row_name(name)
