"""All that a report of the ladder says, as data: its tables, its settings, and what is missing."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pandas as pd

from ..ontology import CLASSES
from ..results.counts import Parts
from ..results.files import AS_RECORDED
from ..results.render import Table
from ..results.runs import UNKNOWN_CODE, UnfinishedRun
from ..results.table import Resamples, joined
from ..run_folder import ANCHORS
from .canvas import readable
from .paper_tables import paper_tables
from .run_group import RunGroup
from .section import Draw, Reported, Section
from .shared_settings import (
    PRECISION,
    grouped,
    listed,
    marks_of,
    settings_table,
    shown_settings,
    surprises,
)

# The caption of the table of the intervals.
SAMPLING = (
    "Percentile intervals over seeds and, independently, clips, the same draws for every row; of a "
    "single seed over clips alone. From fewer than ten seeds or clips they are rather too narrow. "
    "Lost: resamples that draw no voxel of some class, which their means leave out. Blocked: "
    "frames with something in the tube that the body sweeps, on which the collision-miss rate "
    "rests. Of each class: the clips with a labelled voxel."
)
# Its columns before those of the classes.
SAMPLING_FACTS = ("clips", "frames", "seeds", "resamples", "interval", "lost", "blocked")


@dataclass(frozen=True)
class LadderReport:
    """The heading and the tables of the report, and what its numbers rest on.

    ``scores`` is the long table. ``facts`` are tables of the runs and their settings, and
    ``unclean`` is one of the settings for which the rungs may not be comparable, without a row if
    there is none. ``missing`` says which runs are not there, and ``pictures`` has what the sections
    draw, by file name.
    """

    heading: str
    tables: tuple[Table, ...]
    scores: pd.DataFrame
    facts: tuple[Table, ...]
    unclean: Table
    missing: tuple[str, ...]
    pictures: Mapping[str, Draw]


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
    ladder, rungs, parts = group.ladder, group.rungs, group.parts(parts_of)
    of_parts = {part.name: part.resamples for part in parts}
    given = Reported(ladder, group.runs, of_parts, out)
    added = [section(given) for section in sections]

    marks, frames = marks_of(rungs), {run.config["data"]["frames"] for run in rungs}
    tables = [table for part in parts for table in paper_tables(part, marks, frames)]
    tables += [table for each in added for table in each.tables]
    resampled = [*of_parts.values(), *(one for each in added for one in each.resampled)]
    settings = settings_table("settings", "Settings of the runs", shown_settings(group.runs))
    expected = [*ladder.names, *(name for each in added for name in each.experiments)]
    return LadderReport(
        heading=f"Report of {group.runs[0].counts.protocol.dataset}",
        tables=(*tables, sampling_table(resampled)),
        scores=joined([*(part.scores for part in parts), *(each.scores for each in added)]),
        facts=(_facts(group), settings),
        unclean=settings_table("unclean", "Not a clean comparison", surprises(rungs, ladder)),
        missing=tuple(_missing(group, unfinished, seeds, expected)),
        pictures={name: draw for each in added for name, draw in each.pictures.items()},
    )


def _facts(group: RunGroup) -> Table:
    """Returns a table of the runs, the data and the code that the numbers rest on."""
    runs = group.runs
    seeds = grouped((run.experiment, str(run.seed)) for run in runs)
    parameters = grouped((f"{run.row['parameters']:,}", run.experiment) for run in runs)
    recipes = grouped((run.counts.recipe, run.experiment) for run in runs)
    grid = runs[0].counts.protocol.voxel_grid
    unlike = max(run.counts.unlike_labels(runs[0].counts) for run in runs)

    facts = {
        "Runs, seeds": [listed(seeds)],
        # One size or recipe needs no names: it is that of every experiment.
        "Recipe": [listed(recipes)] if len(recipes) > 1 else list(recipes),
        "Dataset": [runs[0].counts.protocol.dataset],
        "Grid": [f"{' x '.join(map(str, grid.shape))} voxels of {grid.voxel_m:g} m"],
        "Code (src/)": [runs[0].code_digest or UNKNOWN_CODE],
        "Commit": [run.row["git_commit"] or "none" for run in runs],
        "Precision": [run.row[PRECISION] for run in runs],
        "Parameters": [listed(parameters)] if len(parameters) > 1 else list(parameters),
        "Labels of other processors": [f"{1e6 * unlike:.1f} of a million voxels"],
    }
    rows = [(name, ["; ".join(dict.fromkeys(values))]) for name, values in facts.items()]
    return Table("facts", "Runs, data and code", "", ["value"], rows, head="Fact")


def sampling_table(parts: Iterable[Resamples]) -> Table:
    """Returns a row for each part of the test split, and each condition of its frames."""
    rows = []
    for part in parts:
        names = [name for name in part.samples if name not in ANCHORS]
        seeds = grouped((", ".join(map(str, part.seeds(name))), name) for name in names)
        frames, clips = part.blocked
        of_seeds = listed(seeds) if len(seeds) > 1 else "".join(seeds)
        facts = [
            *(str(part.clips), str(part.frames), of_seeds),
            *(f"{part.resamples:,}", f"{100 * part.level:g} %", f"{100 * part.lost:.2g} %"),
            f"{frames} in {clips} clips" if "safety" in part.first.tables else "",
            *(str(part.labelled_clips[name]) for name in CLASSES),
        ]

        row = part.part if part.condition == AS_RECORDED else f"{part.part}, {part.condition}"
        rows.append((row, facts))

    columns = [*SAMPLING_FACTS, *map(readable, CLASSES)]
    return Table("sampling", "What the intervals rest on", SAMPLING, columns, rows, head="Part")


def _missing(
    group: RunGroup,
    unfinished: Sequence[UnfinishedRun],
    planned: Sequence[int],
    expected: Iterable[str],
) -> list[str]:
    """Lists runs of the ``expected`` experiments that a full sweep over the seeds would have, and
    other unfinished ones."""
    finished = {(run.experiment, run.seed) for run in group.runs}
    begun = {(run.experiment, run.seed): str(run) for run in unfinished}

    # The seeds that one of them has are expected of every other one.
    seeds = {*planned, *(seed for name, seed in (*finished, *begun) if name in expected)}
    sweep = {key: f"{key[0]} seed {key[1]}: no run" for key in product(expected, sorted(seeds))}
    lines = [line for key, line in (sweep | begun).items() if key not in finished]

    if not group.rungs:
        none = "no finished run of the ladder is here, so no table of its rungs"
        return [f"{none}; task.rungs names others", *lines]
    return lines
