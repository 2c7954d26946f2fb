"""Tables of what attitude does to KAR-mIoU: by tilt, and where it is not measured as it is."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import pandas as pd

from ..results.conditions import LEVEL, TRUE, Condition, Conditions
from ..results.render import Table, table_of
from ..results.table import Presented, Resamples, joined, pivoted
from .captions import ONE_SEED, intervals_over, listed_seeds, lost_classes
from .ladder import PAPER, Ladder

SCORE = "kar_miou"
# Scores of a condition that stand in the long table of a report.
SCORES = ("miou", "miou_occupied", SCORE)

BY_TILT = (
    "KAR-mIoU of the test frames of each tilt |roll| + |pitch|, and below it what a rung gains "
    "over {reference} on the same frames. All numbers are percentages."
)
BY_LEVEL = (
    "KAR-mIoU of the test frames of each tilt where the model is told that the UAV flies level, "
    "and below it what the true attitude is worth to it: the gain over that on the same frames. "
    "All numbers are percentages."
)
BY_FAULT = (
    "KAR-mIoU of the whole test split where the model is told a wrong attitude: noise of a "
    "standard deviation on roll and pitch, drawn once for all runs, or the attitude of some time "
    "ago. All numbers are percentages."
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
            each: Resamples(counts, Presented(each.part, each.presented))
            for each, counts in conditions.items()
        }
        tables = []
        for condition, drawn in resamples.items():
            above = [name for name in drawn.samples if name != ladder.first]
            tables.append(drawn.table({name: [ladder.first] for name in above}))
            if condition.level:
                true = resamples[replace(condition, level=False)]
                tables.append(true.table_of_changes(drawn))

        table = joined(tables)
        return cls(resamples, table[table["score"].isin(SCORES)], ladder)

    def names(self, conditions: Sequence[Condition]) -> list[str]:
        """Returns the experiments that were scored under any of some conditions, in their order."""
        return self.ladder.in_order(
            name for each in conditions for name in self.resamples[each].samples
        )

    def conditions(self, which: str) -> list[Condition]:
        """Returns the conditions of the bins of "tilt", of "level" flight, or of "faults".

        Bins ascend, and all frames come before them; faults begin with the true attitude.
        """
        by_tilt = sorted(self.resamples, key=lambda c: (c.tilt_low_deg, -c.tilt_high_deg))
        if which != "faults":
            is_level = which == "level"
            return [c for c in by_tilt if c.level == is_level and (c.is_bin or is_level)]

        noisy = sorted((c for c in by_tilt if c.noise_deg > 0), key=lambda c: c.noise_deg)
        late = sorted((c for c in by_tilt if c.delay_s > 0), key=lambda c: c.delay_s)
        return [*(c for c in by_tilt if c.name == TRUE), *noisy, *late]

    def rows(self, experiment: str, reference: str = "", condition: str = "") -> pd.DataFrame:
        """Returns KAR-mIoU of an experiment under each condition, beside the condition's facts.

        With a ``reference`` it is the change from that, which may be under another ``condition``.
        """
        facts = [{"part": c.part, "condition": c.presented, **asdict(c)} for c in self.resamples]
        wanted = {"experiment": experiment, "seed": "mean", "score": SCORE}
        wanted |= {"reference": reference, "reference_condition": condition}
        chosen = self.scores[(self.scores[list(wanted)] == pd.Series(wanted)).all(axis=1)]
        return pd.DataFrame(facts).merge(chosen, on=["part", "condition"])


def attitude_tables(attitude: AttitudeScores) -> list[Table]:
    """Returns one table by tilt, one of the same frames told a level attitude, and one by fault, of
    what there is."""
    ladder, tables = attitude.ladder, []
    kinds = {
        "tilt": ("By tilt", BY_TILT, 0),
        "level": ("Told level flight", BY_LEVEL, 0),
        "faults": ("Wrong attitude", BY_FAULT, 1),
    }
    for which, (title, text, fewest) in kinds.items():
        conditions = attitude.conditions(which)
        names = attitude.names(conditions)
        above = [name for name in names if ladder.first in names and name != ladder.first]
        over, keys = ladder.reference, [{"experiment": n, "reference": ladder.first} for n in above]
        # Level flight is compared with the true attitude on the same frames, and not with a rung.
        if which == "level":
            over = "told level"
            true = {"condition": TRUE, "reference_condition": LEVEL}
            keys = [{"experiment": name, "reference": name, **true} for name in names]

        changes = [(f"{ladder.row_name(key['experiment'])}, over {over}", key) for key in keys]
        if len(conditions) > fewest:
            tables.append(_table(attitude, which, title, text, conditions, changes))
    return tables


def _table(
    attitude: AttitudeScores,
    which: str,
    title: str,
    text: str,
    conditions: Sequence[Condition],
    changes: Sequence[tuple[str, dict[str, str]]],
) -> Table:
    """Returns a table of scores and, below a line, of the changes: the keys of their rows."""
    ladder, names = attitude.ladder, attitude.names(conditions)
    rows = [(ladder.row_name(name), {"experiment": name}) for name in names]
    rows += changes
    heads = [_head(condition, attitude.resamples[condition].frames) for condition in conditions]
    if which == "faults":
        heads = [_fault(condition) for condition in conditions]
    keys = [{"condition": c.presented, "part": c.part, "score": SCORE} for c in conditions]
    cells = pivoted(attitude.scores, [key for _, key in rows], keys)

    return Table(
        f"attitude_{which}",
        title,
        f"{text.format(reference=ladder.reference)} {_drawn(attitude, conditions, names)}",
        table_of([(name, row) for (name, _), row in zip(rows, cells)], heads),
        best=dict.fromkeys(heads, "high"),
        lines=(len(names),) if changes else (),
    )


def _drawn(attitude: AttitudeScores, conditions: Sequence[Condition], names: Sequence[str]) -> str:
    """Says how the intervals were drawn; each column has clips of its own."""
    columns = [attitude.resamples[condition] for condition in conditions]
    every = attitude.resamples.values()
    seeds = {name: sorted({s for each in every for s in each.seeds(name)}) for name in names}
    most = max(map(len, seeds.values()))

    of = f"{most} seeds and, independently, of the" if most > 1 else "the"
    text = f"{intervals_over(columns[0])} {of} clips that have such frames, the same for every row."
    text = text if most > 1 else f"{text} {ONE_SEED}."
    return f"{text} {lost_classes(*columns)}{listed_seeds(seeds, differences=True)}"


def _head(condition: Condition, frames: int) -> str:
    low, high = condition.tilt_low_deg, condition.tilt_high_deg
    bounds = f"{low:g}–{high:g}°" if high < float("inf") else f"from {low:g}°" if low else "all"
    return f"{bounds} ({frames} frames)"


def _fault(condition: Condition) -> str:
    if condition.noise_deg > 0:
        return f"{condition.noise_deg:g}° noise"
    return f"{condition.delay_s:g} s late" if condition.delay_s > 0 else "true"
