"""Tables of what attitude does to KAR-mIoU: by tilt, and where poses are measured wrongly."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import pandas as pd

from src.report.ladder import PAPER, Ladder
from src.results.render import Table
from src.results.table import MEAN, Resamples, joined, pivoted
from studies.attitude.conditions import LEVEL, TRUE, Condition, Conditions

SCORE = "kar_miou"
# Scores of a condition that stand in the long table of a report.
SCORES = ("miou", "miou_occupied", SCORE)

BY_TILT = (
    "KAR-mIoU of the test frames of each tilt |roll| + |pitch|, and below it what a rung gains "
    "over {reference} on the same frames. All numbers are percentages, in brackets their intervals."
)
BY_LEVEL = (
    "KAR-mIoU of the test frames of each tilt where the model is told that the UAV flies level, "
    "and below it what the true attitude is worth to it: the gain over that on the same frames. "
    "All numbers are percentages, in brackets their intervals."
)
BY_FAULT = (
    "KAR-mIoU of the whole test split where the model is told wrong poses: noise of a standard "
    "deviation on roll and pitch, roll and pitch of some time ago, too long distances between "
    "frames, or times with an error of a standard deviation. What is random is drawn once for all "
    "runs. All numbers are percentages, in brackets their intervals."
)


@dataclass(frozen=True)
class AttitudeScores:
    """The long table of all conditions, and how each of them was resampled."""

    resamples: dict[Condition, Resamples]
    scores: pd.DataFrame
    ladder: Ladder = PAPER

    @classmethod
    def of(cls, conditions: Conditions, ladder: Ladder = PAPER) -> "AttitudeScores":
        """Resamples what was counted under each condition.

        Differences are from the lowest rung, and of the true attitude from that of level flight.
        """
        resamples = {
            each: Resamples(counts, each.part, each.presented)
            for each, counts in conditions.items()
        }
        tables = []
        for condition, drawn in resamples.items():
            above = [name for name in drawn.samples if name != ladder.first]
            tables.append(drawn.table({name: [ladder.first] for name in above}))
            if condition.level:
                true = resamples[replace(condition, level=False)]
                themselves = {name: [name] for name in true.samples}
                tables.append(true.table_of_changes(themselves, drawn))

        table = joined(tables)
        return cls(resamples, table[table["score"].isin(SCORES)], ladder)

    def names(self, conditions: Iterable[Condition]) -> list[str]:
        """Returns the experiments that were scored under any of some conditions, in their order."""
        return self.ladder.in_order(
            name for each in conditions for name in self.resamples[each].samples
        )

    def rows(self, experiment: str, reference: str = "", condition: str = "") -> pd.DataFrame:
        """Returns KAR-mIoU of an experiment under each condition, beside the condition's facts.

        With a ``reference`` it is the change from that, which may be under another ``condition``.
        """
        facts = [{"part": c.part, "condition": c.presented, **asdict(c)} for c in self.resamples]
        wanted = {"experiment": experiment, "seed": MEAN, "score": SCORE}
        wanted |= {"reference": reference, "reference_condition": condition}
        chosen = self.scores[(self.scores[list(wanted)] == pd.Series(wanted)).all(axis=1)]
        return pd.DataFrame(facts).merge(chosen, on=["part", "condition"])


def attitude_tables(attitude: AttitudeScores) -> list[Table]:
    """Returns one table by tilt, one of the same frames told a level attitude, and one by fault, of
    what there is."""
    bins = [each for each in attitude.resamples if each.is_bin and not each.level]
    level = [each for each in attitude.resamples if each.level]
    # The true attitude stands before them, to compare; it alone makes no table.
    faults = [each for each in attitude.resamples if not (each.is_bin or each.level)]

    chosen = [
        ("tilt", "By tilt", BY_TILT, bins),
        ("level", "Told level flight", BY_LEVEL, level),
        ("faults", "Wrong poses", BY_FAULT, faults if len(faults) > 1 else []),
    ]
    return [_table(attitude, *each) for each in chosen if each[-1]]


def _table(
    attitude: AttitudeScores, which: str, title: str, text: str, conditions: Sequence[Condition]
) -> Table:
    """Returns a table of scores and, below a line, of what they change from something."""
    ladder, names = attitude.ladder, attitude.names(conditions)
    rows = [(ladder.row_name(name), {"experiment": name}) for name in names]
    if which == "level":
        # Compared with the true attitude on the same frames, and not with a rung.
        over, true = "told level", {"condition": TRUE, "reference_condition": LEVEL}
        changes = [{"experiment": name, "reference": name, **true} for name in names]
    else:
        over, above = ladder.reference, [name for name in names if name != ladder.first]
        of_first = {"reference": ladder.first}
        changes = [{"experiment": name, **of_first} for name in above if ladder.first in names]
    rows += [(f"{ladder.row_name(key['experiment'])}, over {over}", key) for key in changes]

    frames = {each: attitude.resamples[each].frames for each in conditions}
    heads = [_fault(c) if which == "faults" else tilt_in_words(c, frames[c]) for c in conditions]
    columns = [{"condition": c.presented, "part": c.part, "score": SCORE} for c in conditions]
    return Table(
        f"attitude_{which}",
        title,
        text.format(reference=ladder.reference),
        heads,
        pivoted(attitude.scores, rows, columns),
        best=dict.fromkeys(heads, "high"),
        lines=(len(names),) if changes else (),
    )


def tilt_in_words(condition: Condition, frames: int) -> str:
    """Returns the tilt of a condition's frames, and how many there are."""
    low, high = condition.tilt_low_deg, condition.tilt_high_deg
    bounds = f"{low:g}–{high:g}°" if high < float("inf") else f"from {low:g}°" if low else "all"
    return f"{bounds} ({frames} frames)"


def _fault(condition: Condition) -> str:
    if condition.noise_deg:
        return f"{condition.noise_deg:g}° noise"
    if condition.distance_off:
        return f"distances {100 * condition.distance_off:g} % too long"
    if condition.time_off_s:
        return f"times off by {1000 * condition.time_off_s:g} ms"
    return f"{condition.delay_s:g} s late" if condition.delay_s else TRUE
