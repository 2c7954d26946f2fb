"""Tables of what attitude does to a score: by tilt, and where it is measured wrongly."""

from collections.abc import Mapping, Sequence

import pandas as pd

from .attitude import SCORE
from .attitude_evidence import AttitudeEvidence
from .ladder import PAPER, Ladder
from .report_table import Cell, Column, ReportTable
from .scored_part import ONE_SEED, listed_seeds

TILT = (
    "KAR-mIoU of the test frames of each tilt |roll| + |pitch|, and below it what a rung gains "
    "over {reference} on the same frames. All numbers are percentages."
)
FAULTS = (
    "KAR-mIoU of the whole test split where the model is told a wrong attitude: noise of a "
    "standard deviation on roll and pitch, drawn once for all runs, or the attitude of some time "
    "ago. All numbers are percentages."
)


def attitude_tables(found: AttitudeEvidence, ladder: Ladder = PAPER) -> list[ReportTable]:
    """One by tilt and one by fault, of what there is."""
    tilts, faults = found.names("tilt"), [*found.names("noise_deg"), *found.names("delay_s")[1:]]
    tables = []
    if tilts:
        columns = [Column(name, _tilt(found, name), best="high") for name in tilts]
        tables.append(_table(found, "attitude_tilt", "By tilt", TILT, columns, ladder))
    if len(faults) > 1:
        columns = [Column(name, _fault(found.conditions.loc[name]), best="high") for name in faults]
        tables.append(_table(found, "attitude_faults", "Wrong attitude", FAULTS, columns, ladder))
    return tables


def _table(
    found: AttitudeEvidence,
    key: str,
    title: str,
    text: str,
    columns: Sequence[Column],
    ladder: Ladder,
) -> ReportTable:
    """Scores, and below a line the gains over the lowest rung, if that is there."""
    experiments, first = ladder.in_order(found.experiments), ladder.first
    rows: list[tuple[str, tuple[Cell | None, ...]]] = [
        (ladder.row_name(name), tuple(found.cell(column.key, name, SCORE) for column in columns))
        for name in experiments
    ]
    lines = ()
    if first in experiments and len(experiments) > 1:
        lines = (len(rows),)
        rows += [
            (
                f"Gain of {ladder.row_name(name).removeprefix('+ ')}",
                tuple(found.gain(column.key, name, first, SCORE) for column in columns),
            )
            for name in experiments
            if name != first
        ]
    seeds = {name: found.seeds(name) for name in experiments}
    text = text.format(reference=ladder.reference)
    caption = f"{text} {_resampling(found, seeds)} {listed_seeds(seeds, differences=True)}"
    return ReportTable(key, title, caption, tuple(columns), tuple(rows), lines=lines)


def _resampling(found: AttitudeEvidence, seeds: Mapping[str, Sequence[int]]) -> str:
    """How the intervals were drawn; the columns have clips of their own."""
    evidence, most = next(iter(found.evidence.values())), max(map(len, seeds.values()))
    drawn = f"{most} seeds and, independently, of the" if most > 1 else "the"
    said = (
        f"In brackets: {100 * evidence.level:g} % percentile intervals over "
        f"{evidence.resamples:,} resamples of {drawn} clips that have such frames, the same for "
        "every row."
    )
    return said if most > 1 else f"{said} {ONE_SEED}."


def _tilt(found: AttitudeEvidence, name: str) -> str:
    low, high = found.conditions.loc[name, ["tilt_low_deg", "tilt_high_deg"]]
    bounds = f"{low:g}–{high:g}°" if high < float("inf") else f"from {low:g}°"
    return f"{bounds} ({found.evidence[name].frames} frames)"


def _fault(facts: pd.Series) -> str:
    if facts["noise_deg"] > 0:
        return f"{facts['noise_deg']:g}° noise"
    return f"{facts['delay_s']:g} s late" if facts["delay_s"] > 0 else "true"
