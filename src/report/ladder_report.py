"""All that a report of the ladder says, as data: its tables, its settings, and what is missing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import pandas as pd

from .ladder import Ladder
from .ladder_tables import (
    BEYOND,
    ablation_table,
    beyond_table,
    incremental_table,
    long_tail_table,
    main_table,
    progression_table,
)
from .report_table import ReportTable
from .results import SCORES
from .run_group import RunGroup
from .scored_part import ScoredPart
from .scored_runs import ScoredRun, UnfinishedRun
from .scores import Parts
from .shared_settings import (
    Values,
    code_lines,
    differing,
    marks_of,
    other_experiments,
    statement,
    surprises,
)


@dataclass(frozen=True)
class LadderReport:
    """``groups`` are the finished runs, those of the tables of differences first. ``warnings`` say
    why the rungs may not be comparable, ``missing`` which runs are not there, and ``others`` what
    the experiments that are no rung are. ``differing`` has the values of every setting in which the
    runs of the ladder differ, and ``seeds`` a row for each run and part."""

    groups: tuple[RunGroup, ...]
    tables: tuple[ReportTable, ...]
    settings: str
    differing: Values
    warnings: tuple[str, ...]
    missing: tuple[str, ...]
    others: tuple[str, ...]
    seeds: pd.DataFrame

    @property
    def ladder(self) -> Ladder:
        return self.groups[0].ladder

    @property
    def runs(self) -> list[ScoredRun]:
        return [run for group in self.groups for run in group.runs]

    @property
    def named_runs(self) -> list[tuple[str, ScoredRun]]:
        """Every run, and what its experiment is called in the tables."""
        return [
            (group.ladder.row_name(run.experiment) + group.label, run)
            for group in self.groups
            for run in group.runs
        ]

    def table(self, key: str) -> ReportTable | None:
        """The table of a key, if it is there."""
        return next((table for table in self.tables if table.key == key), None)


def ladder_report(
    groups: Sequence[RunGroup],
    unfinished: Sequence[UnfinishedRun],
    parts_of: Callable[[Sequence[str]], Parts],
    seeds: Sequence[int] = (),
) -> LadderReport:
    """The report of finished runs, and of what is missing beside them.

    ``parts_of`` gives the parts of the test split for the clips that were never trained on, and
    ``seeds`` are those that every rung is to have, beside the ones that are there. Raises
    `UserError` for tallies and results that do not belong together.
    """
    runs = [run for group in groups for run in group.runs]
    ladder, rungs = groups[0].ladder, groups[0].rungs
    scored = [(group, part) for group in groups for part in group.scored_parts(parts_of)]
    tables = [
        table
        for group, part in scored
        if group is groups[0]
        for table in _tables(part, [p for g, p in scored if g is not group], rungs)
    ]
    return LadderReport(
        groups=tuple(groups),
        tables=tuple(table for table in tables if table.rows and table.columns),
        settings=statement(rungs or groups[0].runs, ladder),
        differing=differing(rungs or groups[0].runs),
        warnings=(*surprises(rungs, ladder), *code_lines(runs), *_mixed(groups)),
        missing=tuple(_missing(groups, unfinished, seeds)),
        others=tuple(other_experiments(groups[0].runs, ladder)),
        seeds=_seeds(scored),
    )


def _tables(
    part: ScoredPart, of_others: Sequence[ScoredPart], rungs: Sequence[ScoredRun]
) -> list[ReportTable]:
    """The tables of one part; ``of_others`` are parts of other groups, for the tables of all."""
    parts = [part, *(other for other in of_others if other.name == part.name)]
    tables = [main_table(parts), ablation_table(part, marks_of(rungs))]
    # The paper has these of the whole split alone.
    if part.name == "test" and rungs:
        frames = {run.config["data"]["frames"] for run in rungs}
        tables += [long_tail_table(part, frames), incremental_table(part)]
        tables.append(progression_table(part, frames))
    return [*tables, beyond_table(parts)]


def _missing(
    groups: Sequence[RunGroup], unfinished: Sequence[UnfinishedRun], planned: Sequence[int]
) -> list[str]:
    """Runs of the ladder that a full sweep over the seeds would have, and other unfinished ones."""
    there, apart = (
        {(run.experiment, run.seed) for group in some for run in group.runs}
        for some in (groups[:1], groups[1:])
    )
    ladder = groups[0].ladder
    begun = {(run.experiment, run.seed): run for run in unfinished}
    of_ladder = {key for key in (*there, *begun) if key[0] in ladder}
    lines = []
    seeds = sorted({*planned, *(seed for _, seed in of_ladder)})
    for key in product(ladder.names, seeds):
        if key not in there | apart:
            run = begun.pop(key, None)
            lines.append(str(run) if run else f"{key[0]} seed {key[1]}: no run")
    lines += [str(run) for key, run in begun.items() if key not in there | apart]
    if not any(name in ladder for name, _ in there):
        return ["no finished run of the ladder is here, so no table of its rungs", *lines]
    return lines + _uneven(groups[0])


def _uneven(group: RunGroup) -> list[str]:
    """What rungs of different seeds mean for their differences."""
    seeds = {
        name: tuple(run.seed for run in group.runs if run.experiment == name)
        for name in group.ladder.names
    }
    if len({of_rung for of_rung in seeds.values() if of_rung}) < 2:
        return []
    return [
        "rungs have different seeds: a difference is over those that both have, and so not the "
        "difference of the means beside it"
    ]


def _mixed(groups: Sequence[RunGroup]) -> list[str]:
    """What stands in the report although it cannot be compared."""
    return [
        f"scored unlike the others{group.label}, so without differences: "
        f"{', '.join(map(str, group.runs))}. {statement(group.runs, group.ladder)}"
        for group in groups[1:]
    ]


def _seeds(scored: Sequence[tuple[RunGroup, ScoredPart]]) -> pd.DataFrame:
    """Scores of every run on every part, in percent."""
    scores = [*SCORES, *(score for score in BEYOND if score not in SCORES)]
    rows = [
        {
            **{"experiment": run.experiment + group.label, "seed": run.seed, "split": part.name},
            **{"dataset": part.dataset, "clips": part.evidence.clips},
            **{name: part.evidence.value(run.experiment, run.seed, name) for name in scores},
        }
        for group, part in scored
        for run in group.runs
    ]
    return pd.DataFrame(rows)
