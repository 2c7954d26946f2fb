"""What a report was made from, small enough to be published: a report can be made from it again."""

import dataclasses
import shutil
from collections.abc import Sequence
from pathlib import Path

from ..atomic_folder import replacing_folder
from ..metrics.tally import Tally
from ..run_folder import CODE, CONFIG, METRICS, RESULTS, TALLIES
from .attitude_evidence import ATTITUDE, TABLE
from .evidence import METRICS as COUNTED
from .run_group import RunGroup
from .scored_runs import ScoredRun

FILES = (CONFIG, CODE, METRICS, RESULTS, f"{ATTITUDE}/{TABLE}")


def publish_runs(groups: Sequence[RunGroup], folder: Path) -> None:
    """Writes ``<folder>/<experiment>/seed<k>`` of every run: its configuration, code digest, curves
    and results, and of its counts by clip those that a report reads. The anchors are the same
    beside every run of a group, so they are written once. Further groups of a mixed report have
    folders of their own, ``<folder>/group2`` and so on.

    Raises `UserError` for a file that cannot be written.
    """
    # The old folder may be what the report was made from.
    with replacing_folder(folder) as new:
        for n, group in enumerate(groups, start=1):
            place = new if n == 1 else new / f"group{n}"
            for run in group.runs:
                anchors = run.anchors.values() if run is group.runs[0] else ()
                _publish(run, (run.tally, *anchors), place / run.experiment / f"seed{run.seed}")


def _publish(run: ScoredRun, tallies: Sequence[Tally], place: Path) -> None:
    for path in (*FILES, *_attitude_tallies(run)):
        if (run.path / path).is_file():
            (place / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(run.path / path, place / path)
    for tally in tallies:
        tables = {name: table for name, table in tally.tables.items() if name in COUNTED}
        dataclasses.replace(tally, tables=tables).write(place / TALLIES / f"{tally.name}.npz")


def _attitude_tallies(run: ScoredRun) -> list[str]:
    tallies = (run.path / ATTITUDE / TALLIES).glob("*.npz")
    return [str(path.relative_to(run.path)) for path in sorted(tallies)]
