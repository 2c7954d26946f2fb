"""Tables of what attitude does to a score: by tilt, and where it is measured wrongly."""

from collections.abc import Sequence

import pandas as pd

from .attitude import SCORE
from .attitude_evidence import AttitudeEvidence
from .ladder import FIRST, in_order, row_name
from .report_table import Cell, Column, ReportTable

TILT = (
    "KAR-mIoU of the test frames of each tilt |roll| + |pitch|, and below it what a rung gains "
    "over the baseline on the same frames. All numbers are percentages."
)
FAULTS = (
    "KAR-mIoU of the whole test split where the model is told a wrong attitude: noise of a "
    "standard deviation on roll and pitch, or the attitude of some time ago. All numbers are "
    "percentages."
)


def attitude_tables(found: AttitudeEvidence) -> list[ReportTable]:
    """One by tilt and one by fault, of what there is."""
    tilts, faults = found.names("tilt"), [*found.names("noise_deg"), *found.names("delay_s")[1:]]
    tables = []
    if tilts:
        columns = [Column(name, _tilt(found, name), best="high") for name in tilts]
        tables.append(_table(found, "attitude_tilt", "By tilt", TILT, columns))
    if len(faults) > 1:
        columns = [Column(name, _fault(found.conditions.loc[name]), best="high") for name in faults]
        tables.append(_table(found, "attitude_faults", "Wrong attitude", FAULTS, columns))
    return tables


def _table(
    found: AttitudeEvidence, key: str, title: str, text: str, columns: Sequence[Column]
) -> ReportTable:
    """Scores, and below a line the gains over the baseline, if that is there."""
    experiments = in_order(found.experiments)
    rows: list[tuple[str, tuple[Cell | None, ...]]] = [
        (row_name(name), tuple(found.cell(column.key, name, SCORE) for column in columns))
        for name in experiments
    ]
    lines = ()
    if FIRST in experiments and len(experiments) > 1:
        lines = (len(rows),)
        rows += [
            (
                f"Gain of {name}",
                tuple(found.gain(column.key, name, FIRST, SCORE) for column in columns),
            )
            for name in experiments
            if name != FIRST
        ]
    seeds = {name: found.seeds(name) for name in experiments}
    said = "; ".join(f"{name} {', '.join(map(str, of_one))}" for name, of_one in seeds.items())
    level = 100 * next(iter(found.evidence.values())).level
    caption = (
        f"{text} In brackets: {level:g} % intervals over resampled clips and seeds. Seeds: {said}."
    )
    return ReportTable(key, title, caption, tuple(columns), tuple(rows), lines=lines)


def _tilt(found: AttitudeEvidence, name: str) -> str:
    low, high = found.conditions.loc[name, ["tilt_low_deg", "tilt_high_deg"]]
    bounds = f"{low:g}–{high:g}°" if high < float("inf") else f"from {low:g}°"
    return f"{bounds} ({found.evidence[name].frames} frames)"


def _fault(facts: pd.Series) -> str:
    if facts["noise_deg"] > 0:
        return f"{facts['noise_deg']:g}° noise"
    return f"{facts['delay_s']:g} s late" if facts["delay_s"] > 0 else "true"
