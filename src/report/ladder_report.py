"""All that a report of the ladder says, as data: its tables, its settings, and what is missing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pandas as pd

from ..results.render import Table
from ..results.runs import ScoredRun, UnfinishedRun
from ..results.table import Parts, joined
from .paper_tables import paper_tables
from .run_group import RunGroup, long_table
from .section import Draw, Reported, Section
from .shared_settings import (
    Values,
    code_lines,
    differing,
    grouped,
    marks_of,
    other_experiments,
    statement,
    surprises,
)


@dataclass(frozen=True)
class LadderReport:
    """``groups`` are the finished runs, those of the tables of differences first.

    ``scores`` is the long table. ``warnings`` say why the rungs may not be comparable, ``missing``
    which runs are not there, and ``others`` what the experiments that are no rung are.
    ``differing`` has the values of every setting in which the runs of the ladder differ, and
    ``pictures`` what the sections draw, by file name.
    """

    groups: tuple[RunGroup, ...]
    tables: tuple[Table, ...]
    scores: pd.DataFrame
    settings: str
    differing: Values
    warnings: tuple[str, ...]
    missing: tuple[str, ...]
    others: tuple[str, ...]
    pictures: Mapping[str, Draw]

    @property
    def runs(self) -> list[ScoredRun]:
        return [run for group in self.groups for run in group.runs]

    @property
    def named_runs(self) -> list[tuple[str, ScoredRun]]:
        """Every run, and the name of its experiment in the tables."""
        return [
            (group.ladder.row_name(run.experiment) + group.label, run)
            for group in self.groups
            for run in group.runs
        ]

    def table(self, key: str) -> Table | None:
        """Returns the table of a key, if it is there."""
        return next((table for table in self.tables if table.key == key), None)


def ladder_report(
    groups: Sequence[RunGroup],
    unfinished: Sequence[UnfinishedRun],
    parts_of: Callable[[Sequence[str]], Parts],
    out: Path,
    seeds: Sequence[int] = (),
    sections: Sequence[Callable[[Reported], Section]] = (),
) -> LadderReport:
    """Returns the report of finished runs, and of what is missing beside them.

    ``parts_of`` gives the parts of the test split for the clips that were never trained on, ``out``
    is the folder of the report, ``seeds`` are those that every rung is to have, beside the ones
    that are there, and ``sections`` add to it. Raises `UserError` for counts and results that do
    not belong together, and as the sections do.
    """
    runs = [run for group in groups for run in group.runs]
    ladder, rungs = groups[0].ladder, groups[0].rungs
    # Tables of differences are of the first group; others only have rows beside it.
    parts, *further = [group.parts(parts_of) for group in groups]
    of_others = [part for of_group in further for part in of_group]
    marks, frames = marks_of(rungs), {run.config["data"]["frames"] for run in rungs}

    tables = []
    for part in parts:
        same = [each for each in of_others if each.name == part.name]
        tables += paper_tables(part, same, marks, frames)
    of_parts = {part.name: part.resamples for part in parts}
    given = Reported(ladder, groups[0].runs, of_parts, out)
    added = [section(given) for section in sections]
    expected = [name for each in added for name in each.experiments]
    return LadderReport(
        groups=tuple(groups),
        tables=(*tables, *(table for each in added for table in each.tables)),
        scores=joined([long_table([*parts, *of_others]), *(each.scores for each in added)]),
        settings=statement(rungs or groups[0].runs, ladder),
        differing=differing(rungs or groups[0].runs),
        warnings=(
            *surprises(rungs, ladder),
            *code_lines(runs),
            *_made_elsewhere(groups),
            *_mixed(groups),
        ),
        missing=tuple(_missing(groups, unfinished, seeds, expected)),
        others=tuple(other_experiments(groups[0].runs, ladder)),
        pictures={name: draw for each in added for name, draw in each.pictures.items()},
    )


def _missing(
    groups: Sequence[RunGroup],
    unfinished: Sequence[UnfinishedRun],
    planned: Sequence[int],
    expected: Sequence[str],
) -> list[str]:
    """Lists runs of the ladder, and of other ``expected`` experiments, that a full sweep over the
    seeds would have, and other unfinished ones."""
    ladder = groups[0].ladder
    names = dict.fromkeys((*ladder.names, *expected))
    finished = {(run.experiment, run.seed) for group in groups for run in group.runs}
    compared = {(run.experiment, run.seed) for run in groups[0].runs}
    begun = {(run.experiment, run.seed): run for run in unfinished}
    # The seeds that one of them has are expected of every other one.
    of_sweep = {key for key in (*compared, *begun) if key[0] in names}

    lines = []
    for key in product(names, sorted({*planned, *(seed for _, seed in of_sweep)})):
        if key not in finished:
            run = begun.pop(key, None)
            lines.append(str(run) if run else f"{key[0]} seed {key[1]}: no run")
    lines += [str(run) for key, run in begun.items() if key not in finished]

    seeds = grouped(key for key in sorted(compared) if key[0] in ladder)
    if not seeds:
        return ["no finished run of the ladder is here, so no table of its rungs", *lines]
    if len(set(map(tuple, seeds.values()))) > 1:
        lines.append(
            "rungs have different seeds: a difference is over those that both have, and so not the "
            "difference of the means beside it"
        )
    return lines


def _made_elsewhere(groups: Sequence[RunGroup]) -> list[str]:
    """Says how far labels differ of which processors made a few otherwise."""
    return [
        f"runs{group.label} were scored on labels of several processors, unlike in up to "
        f"{1e6 * group.unlike_labels:.1f} of a million voxels"
        for group in groups
        if group.unlike_labels
    ]


def _mixed(groups: Sequence[RunGroup]) -> list[str]:
    """Says what stands in the report although it cannot be compared."""
    return [
        f"scored unlike the others{group.label}, so without differences: "
        f"{', '.join(map(str, group.runs))}. {statement(group.runs, group.ladder)}"
        for group in groups[1:]
    ]
