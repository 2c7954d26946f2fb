"""Tables of what attitude does to a score: by tilt, and where it is not measured as it is."""

from collections.abc import Callable, Mapping, Sequence

import pandas as pd

from .attitude import SCORE
from .attitude_evidence import AttitudeEvidence
from .evidence import Evidence
from .ladder import PAPER, Ladder
from .report_table import Cell, Column, ReportTable
from .scored_part import ONE_SEED, listed_seeds, lost_classes

TILT = (
    "KAR-mIoU of the test frames of each tilt |roll| + |pitch|, and below it what a rung gains "
    "over {reference} on the same frames. All numbers are percentages."
)
LEVEL = (
    "KAR-mIoU of the test frames of each tilt where the model is told that the UAV flies level, "
    "and below it what the true attitude is worth to it: the gain over that on the same frames. "
    "All numbers are percentages."
)
FAULTS = (
    "KAR-mIoU of the whole test split where the model is told a wrong attitude: noise of a "
    "standard deviation on roll and pitch, drawn once for all runs, or the attitude of some time "
    "ago. All numbers are percentages."
)

Row = tuple[str, tuple[Cell | None, ...]]


def attitude_tables(found: AttitudeEvidence, ladder: Ladder = PAPER) -> list[ReportTable]:
    """One by tilt, one of the same frames told a level attitude, and one by fault, of what there
    is."""
    tilts, levels = (
        [Column(name, _tilt(found, name), best="high") for name in found.names(which)]
        for which in ("tilt", "level")
    )
    faults = [
        Column(name, _fault(found.conditions.loc[name]), best="high")
        for name in [*found.names("noise_deg"), *found.names("delay_s")[1:]]
    ]
    tables = []
    if tilts:
        gains = _gains(found, tilts, ladder)
        tables.append(_table(found, "attitude_tilt", "By tilt", TILT, tilts, gains, ladder))
    if levels:
        name, worths = "Told level flight", _worths(found, levels, ladder)
        tables.append(_table(found, "attitude_level", name, LEVEL, levels, worths, ladder))
    if len(faults) > 1:
        gains = _gains(found, faults, ladder)
        tables.append(
            _table(found, "attitude_faults", "Wrong attitude", FAULTS, faults, gains, ladder)
        )
    return tables


def _gains(found: AttitudeEvidence, columns: Sequence[Column], ladder: Ladder) -> list[Row]:
    """Over the lowest rung; none where that is not there."""
    first, there = ladder.first, _scored(found, columns)
    above = [name for name in there if name != first and first in there]
    over = f", over {ladder.reference}"
    return _rows(
        lambda key, name: found.gain(key, name, first, SCORE), above, columns, ladder, over
    )


def _worths(found: AttitudeEvidence, columns: Sequence[Column], ladder: Ladder) -> list[Row]:
    return _rows(
        lambda key, name: found.worth(key, name, SCORE),
        _scored(found, columns),
        columns,
        ladder,
        ", over told level",
    )


def _rows(
    cell: Callable[[str, str], Cell | None],
    experiments: Sequence[str],
    columns: Sequence[Column],
    ladder: Ladder,
    over: str = "",
) -> list[Row]:
    """A row for each experiment, of the ``cell`` of each condition and it."""
    return [
        (ladder.row_name(name) + over, tuple(cell(column.key, name) for column in columns))
        for name in ladder.in_order(experiments)
    ]


def _scored(found: AttitudeEvidence, columns: Sequence[Column]) -> list[str]:
    """The experiments that have a score in any of the columns."""
    return [
        name
        for name in found.experiments
        if any(found.evidence[column.key].seeds(name) for column in columns)
    ]


def _table(
    found: AttitudeEvidence,
    key: str,
    title: str,
    text: str,
    columns: Sequence[Column],
    differences: Sequence[Row],
    ladder: Ladder,
) -> ReportTable:
    """Scores, and below a line the differences."""
    names = _scored(found, columns)
    scores = _rows(lambda key, name: found.cell(key, name, SCORE), names, columns, ladder)
    seeds = {name: found.seeds(name) for name in ladder.in_order(names)}
    text = text.format(reference=ladder.reference)
    drawn = _resampling([found.evidence[column.key] for column in columns], seeds)
    caption = f"{text} {drawn} {listed_seeds(seeds, differences=True)}"
    lines = (len(scores),) if differences else ()
    return ReportTable(key, title, caption, tuple(columns), (*scores, *differences), lines=lines)


def _resampling(columns: Sequence[Evidence], seeds: Mapping[str, Sequence[int]]) -> str:
    """How the intervals were drawn; the columns have clips of their own."""
    evidence, most = columns[0], max(map(len, seeds.values()))
    drawn = f"{most} seeds and, independently, of the" if most > 1 else "the"
    said = (
        f"In brackets: {100 * evidence.level:g} % percentile intervals over "
        f"{evidence.resamples:,} resamples of {drawn} clips that have such frames, the same for "
        "every row."
    )
    said = said if most > 1 else f"{said} {ONE_SEED}."
    return f"{said} {lost_classes(*columns)}".rstrip()


def _tilt(found: AttitudeEvidence, name: str) -> str:
    low, high = found.conditions.loc[name, ["tilt_low_deg", "tilt_high_deg"]]
    bounds = f"{low:g}–{high:g}°" if high < float("inf") else f"from {low:g}°" if low else "all"
    return f"{bounds} ({found.evidence[name].frames} frames)"


def _fault(facts: pd.Series) -> str:
    if facts["noise_deg"] > 0:
        return f"{facts['noise_deg']:g}° noise"
    return f"{facts['delay_s']:g} s late" if facts["delay_s"] > 0 else "true"
