"""All that a report of the ladder says, as data: its tables, its settings, and what is missing."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pandas as pd

from ..results.render import Table
from ..results.runs import UNKNOWN_CODE, ScoredRun, UnfinishedRun
from ..results.table import Parts, joined
from .paper_tables import paper_tables
from .run_group import RunGroup
from .sampling import sampling_table
from .section import Draw, Reported, Section
from .shared_settings import (
    PRECISION,
    differing,
    grouped,
    listed,
    marks_of,
    others_table,
    settings_table,
    shared_table,
    surprises,
)


@dataclass(frozen=True)
class LadderReport:
    """``group`` are the finished runs.

    ``scores`` is the long table. ``facts`` are tables of what the numbers rest on, and ``unclean``
    is one of the settings for which the rungs may not be comparable, without a row if there is
    none. ``missing`` says which runs are not there, and ``pictures`` has what the sections draw, by
    file name.
    """

    group: RunGroup
    tables: tuple[Table, ...]
    scores: pd.DataFrame
    facts: tuple[Table, ...]
    unclean: Table
    missing: tuple[str, ...]
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
    tables += [table for each in added for table in each.tables]
    resampled = [*of_parts.values(), *(one for each in added for one in each.resampled)]
    return LadderReport(
        group=group,
        tables=(*tables, sampling_table(resampled)),
        scores=joined([*(part.scores for part in parts), *(each.scores for each in added)]),
        facts=tuple(table for table in _facts(group) if table.rows),
        unclean=settings_table("unclean", "Not a clean comparison", surprises(rungs, ladder)),
        missing=tuple(_missing(group, unfinished, seeds, expected)),
        pictures={name: draw for each in added for name, draw in each.pictures.items()},
    )


def _facts(group: RunGroup) -> Iterator[Table]:
    """Yields tables of the runs, the data, the code and the settings that the numbers rest on."""
    runs, compared = group.runs, group.rungs or group.runs
    seeds = grouped((run.experiment, str(run.seed)) for run in runs)
    parameters = grouped((f"{run.row['parameters']:,}", run.experiment) for run in runs)
    grid = runs[0].counts.protocol.voxel_grid

    facts = {
        "Runs, seeds": [listed(seeds)],
        "Dataset": [runs[0].counts.protocol.dataset],
        "Grid": [f"{' x '.join(map(str, grid.shape))} voxels of {grid.voxel_m:g} m"],
        "Code (src/)": [runs[0].code_digest or UNKNOWN_CODE],
        "Commit": [run.row["git_commit"] or "none" for run in runs],
        "Precision": [run.row[PRECISION] for run in runs],
        # One size needs no names: it is that of every experiment.
        "Parameters": [listed(parameters)] if len(parameters) > 1 else list(parameters),
        "Labels of other processors": [f"{1e6 * group.unlike_labels:.1f} of a million voxels"],
    }
    rows = [(name, ["; ".join(dict.fromkeys(values))]) for name, values in facts.items()]
    yield Table("facts", "Runs, data and code", "", ["value"], rows, head="Fact")
    yield shared_table(compared)
    yield settings_table("differing", "What the rungs do not share", differing(compared))
    yield others_table(runs, group.ladder)


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

    if not group.rungs:
        return ["no finished run of the ladder is here, so no table of its rungs", *lines]
    return lines
