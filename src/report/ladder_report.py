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
from .run_group import RunGroup
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
    """``group`` are the finished runs.

    ``scores`` is the long table. ``warnings`` say why the rungs may not be comparable, ``missing``
    which runs are not there, and ``others`` what the experiments that are no rung are.
    ``differing`` has the values of every setting in which the runs of the ladder differ, and
    ``pictures`` what the sections draw, by file name.
    """

    group: RunGroup
    tables: tuple[Table, ...]
    scores: pd.DataFrame
    settings: str
    differing: Values
    warnings: tuple[str, ...]
    missing: tuple[str, ...]
    others: tuple[str, ...]
    pictures: Mapping[str, Draw]

    @property
    def runs(self) -> Sequence[ScoredRun]:
        return self.group.runs

    @property
    def named_runs(self) -> list[tuple[str, ScoredRun]]:
        """Every run, and the name of its experiment in the tables."""
        return [(self.group.ladder.row_name(run.experiment), run) for run in self.runs]

    def table(self, key: str) -> Table | None:
        """Returns the table of a key, if it is there."""
        return next((table for table in self.tables if table.key == key), None)


def ladder_report(
    group: RunGroup,
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
    ladder, rungs = group.ladder, group.rungs
    parts = group.parts(parts_of)
    marks, frames = marks_of(rungs), {run.config["data"]["frames"] for run in rungs}

    tables = [table for part in parts for table in paper_tables(part, marks, frames)]
    of_parts = {part.name: part.resamples for part in parts}
    given = Reported(ladder, group.runs, of_parts, out)
    added = [section(given) for section in sections]
    expected = [name for each in added for name in each.experiments]
    return LadderReport(
        group=group,
        tables=(*tables, *(table for each in added for table in each.tables)),
        scores=joined([*(part.scores for part in parts), *(each.scores for each in added)]),
        settings=statement(rungs or group.runs, ladder),
        differing=differing(rungs or group.runs),
        warnings=(
            *surprises(rungs, ladder),
            *code_lines(group.runs),
            *_made_elsewhere(group),
        ),
        missing=tuple(_missing(group, unfinished, seeds, expected)),
        others=tuple(other_experiments(group.runs, ladder)),
        pictures={name: draw for each in added for name, draw in each.pictures.items()},
    )


def _missing(
    group: RunGroup,
    unfinished: Sequence[UnfinishedRun],
    planned: Sequence[int],
    expected: Sequence[str],
) -> list[str]:
    """Lists runs of the ladder, and of other ``expected`` experiments, that a full sweep over the
    seeds would have, and other unfinished ones."""
    ladder = group.ladder
    names = dict.fromkeys((*ladder.names, *expected))
    finished = {(run.experiment, run.seed) for run in group.runs}
    begun = {(run.experiment, run.seed): run for run in unfinished}
    # The seeds that one of them has are expected of every other one.
    of_sweep = {key for key in (*finished, *begun) if key[0] in names}

    lines = []
    for key in product(names, sorted({*planned, *(seed for _, seed in of_sweep)})):
        if key not in finished:
            run = begun.pop(key, None)
            lines.append(str(run) if run else f"{key[0]} seed {key[1]}: no run")
    lines += [str(run) for key, run in begun.items() if key not in finished]

    seeds = grouped(key for key in sorted(finished) if key[0] in ladder)
    if not seeds:
        return ["no finished run of the ladder is here, so no table of its rungs", *lines]
    if len(set(map(tuple, seeds.values()))) > 1:
        lines.append(
            "rungs have different seeds: a difference is over those that both have, and so not the "
            "difference of the means beside it"
        )
    return lines


def _made_elsewhere(group: RunGroup) -> list[str]:
    """Says how far labels differ of which processors made a few otherwise."""
    if not group.unlike_labels:
        return []
    return [
        "runs were scored on labels of several processors, unlike in up to "
        f"{1e6 * group.unlike_labels:.1f} of a million voxels"
    ]
