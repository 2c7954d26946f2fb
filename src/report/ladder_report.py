"""All that a report of the ladder says, as data: its tables, its settings, and what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from .ladder import LADDER
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
    """``warnings`` say why the rungs may not be comparable, ``missing`` which runs are not there,
    and ``others`` what the experiments that are no rung are. ``differing`` has the values of every
    setting in which the runs of the ladder differ, and ``seeds`` a row for each run and part."""

    runs: tuple[ScoredRun, ...]
    tables: tuple[ReportTable, ...]
    settings: str
    differing: Values
    warnings: tuple[str, ...]
    missing: tuple[str, ...]
    others: tuple[str, ...]
    seeds: pd.DataFrame

    def table(self, key: str) -> ReportTable | None:
        """The table of a key, if it is there."""
        return next((table for table in self.tables if table.key == key), None)


def ladder_report(
    groups: Sequence[RunGroup], unfinished: Sequence[UnfinishedRun], parts: Parts
) -> LadderReport:
    """The report of finished runs, and of what is missing beside them.

    ``parts`` are those of the test split. Raises `UserError` for tallies and results that do not
    belong together.
    """
    runs, rungs = [run for group in groups for run in group.runs], groups[0].rungs
    scored = [(group, part) for group in groups for part in group.scored_parts(parts)]
    by_part: dict[str, list[ScoredPart]] = {}
    for _, part in scored:
        by_part.setdefault(part.name, []).append(part)
    tables = [table for of_part in by_part.values() for table in _tables(of_part, rungs)]
    return LadderReport(
        runs=tuple(runs),
        tables=tuple(table for table in tables if table.rows and table.columns),
        settings=statement(rungs) if rungs else "",
        differing=differing(rungs),
        warnings=(*surprises(rungs), *code_lines(runs), *_mixed(groups)),
        missing=tuple(_missing(groups[0], unfinished)),
        others=tuple(other_experiments(groups[0].runs)),
        seeds=_seeds(scored),
    )


def _tables(parts: Sequence[ScoredPart], rungs: Sequence[ScoredRun]) -> list[ReportTable]:
    """The tables of one part. Those of the ladder are of the first group alone."""
    first, marks = parts[0], marks_of(rungs)
    tables = [main_table(parts), ablation_table(first, marks)]
    # The paper has the others of the whole split alone.
    if first.name == "test" and rungs:
        frames = rungs[0].config["data"]["frames"]
        tables += [long_tail_table(first, frames), incremental_table(first)]
        tables.append(progression_table(first, frames))
    return [*tables, beyond_table(parts)]


def _missing(group: RunGroup, unfinished: Sequence[UnfinishedRun]) -> list[str]:
    """Runs of the ladder that a full sweep over the seeds would have, and other unfinished ones."""
    there = {(run.experiment, run.seed) for run in group.runs}
    begun = {(run.experiment, run.seed): run for run in unfinished}
    found = {key for key in (*there, *begun) if key[0] in LADDER}
    lines = []
    for key in [(name, seed) for name in LADDER for seed in sorted({seed for _, seed in found})]:
        if key not in there:
            run = begun.pop(key, None)
            lines.append(str(run) if run else f"{key[0]} seed {key[1]}: no run")
    lines += [str(run) for key, run in begun.items() if key not in there]
    seeds = {name: {seed for other, seed in there if other == name} for name, _ in there}
    if len({frozenset(seeds[name]) for name in seeds if name in LADDER}) > 1:
        lines.append(
            "rungs have different seeds: a difference is over those that both have, and so not "
            "the difference of the means beside it"
        )
    return lines if found else ["no run of the ladder is here, so no table of its rungs", *lines]


def _mixed(groups: Sequence[RunGroup]) -> list[str]:
    """What stands in the report although it cannot be compared."""
    return [
        f"scored unlike the others{group.label}, so without differences: "
        f"{', '.join(map(str, group.runs))}"
        for group in groups[1:]
    ]


def _seeds(scored: Sequence[tuple[RunGroup, ScoredPart]]) -> pd.DataFrame:
    """Scores of every run on every part, in percent."""
    scores = [*SCORES, *(score for score in BEYOND if score not in SCORES)]
    rows = [
        {
            **{"experiment": run.experiment, "seed": run.seed, "split": part.name},
            **{"dataset": part.dataset, "clips": part.evidence.clips},
            **{name: part.evidence.value(run.experiment, run.seed, name) for name in scores},
        }
        for group, part in scored
        for run in group.runs
    ]
    return pd.DataFrame(rows)
