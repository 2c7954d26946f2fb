"""What task=attitude scored of several runs, put together: by tilt, and under a wrong attitude."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from ..errors import UserError
from ..metrics.protocol import require_same_protocol
from ..metrics.tally import Tally
from ..run_folder import TALLIES
from .evidence import Evidence
from .report_table import Cell
from .scored_runs import ScoredRun

ATTITUDE, TABLE = "attitude", "attitude.csv"
TILT = ["tilt_low_deg", "tilt_high_deg"]
FACTS = [*TILT, "noise_deg", "delay_s", "level", "noise_seed"]
"""What tells the conditions apart; the columns of ``attitude.csv`` that are no scores."""
TRUE = "true"
MOVED = 1e-4
"""Share of the voxels that another machine, or another batch, may tip. Two seeds of a rung, even
where their mIoU is the same, differ in ten times as many and more."""
AGAIN = "score both alike with task=attitude"


class AttitudeEvidence:
    """Scores of experiments under every condition that task=attitude has scored them under.

    ``conditions`` has a row for each, by its name, with `FACTS`.
    """

    def __init__(self, runs: Sequence[ScoredRun]) -> None:
        """Raises `UserError` for scores that cannot be read, or that are not of the same frames
        under the same conditions."""
        scored = [run for run in runs if (run.path / ATTITUDE / TABLE).is_file()]
        paths = [run.path / ATTITUDE / TABLE for run in scored]
        tables = {path: _conditions(path) for path in paths}
        conditions = pd.concat(tables.values()) if tables else pd.DataFrame(columns=FACTS)
        self.conditions = conditions[~conditions.index.duplicated()]
        _require_alike(tables, self.conditions)
        _require_the_same_of_all_seeds(scored, tables)
        for run in scored:
            _require_own(run)
        scored_as = list(zip(scored, tables.values()))
        self.evidence = {
            name: _evidence(name, [run for run, each in scored_as if name in each.index])
            for name in self.conditions.index
        }
        self.experiments = list(dict.fromkeys(run.experiment for run in scored))

    def names(self, which: str) -> list[str]:
        """The conditions of the bins of ``tilt``; of all frames and then each bin told a ``level``
        attitude; or of faults by ``noise_deg`` or ``delay_s``; in their order. Faults begin with
        the true attitude."""
        level = self.conditions["level"].astype(bool)
        binned = is_binned(self.conditions)
        if which in ("tilt", "level"):
            found = self.conditions[level if which == "level" else binned & ~level]
            return list(found.sort_values(TILT, ascending=[True, False]).index)
        faulty = self.conditions[self.conditions[which] > 0].sort_values(which)
        return [*(name for name in (TRUE,) if name in self.evidence), *faulty.index]

    def seeds(self, experiment: str) -> list[int]:
        """Of an experiment, under any condition."""
        return sorted({s for each in self.evidence.values() for s in each.seeds(experiment)})

    def cell(self, condition: str, experiment: str, score: str) -> Cell | None:
        return self.evidence[condition].cell(experiment, score)

    def gain(self, condition: str, experiment: str, reference: str, score: str) -> Cell | None:
        """Paired, over the seeds that both have."""
        return self.evidence[condition].difference(experiment, reference, score)

    def worth(self, condition: str, experiment: str, score: str) -> Cell | None:
        """What the true attitude gains over a ``level`` one on the same frames, paired."""
        same = (self.conditions[TILT] == self.conditions.loc[condition, TILT]).all(axis=1)
        (true,) = self.conditions.index[same].intersection([TRUE, *self.names("tilt")])
        told = self.evidence[condition]
        return self.evidence[true].difference(experiment, experiment, score, told)

    def table(self, score: str, experiment: str, reference: str | None = None) -> pd.DataFrame:
        """A row for each condition with `FACTS`, ``frames``, and ``value``, ``low`` and ``high`` of
        a score or, with a ``reference``, of its gain; as shares of 1, as in ``attitude.csv``."""
        if reference is None:
            return self._table(lambda name: self.cell(name, experiment, score))
        return self._table(lambda name: self.gain(name, experiment, reference, score))

    def worths(self, score: str, experiment: str) -> pd.DataFrame:
        """What the true attitude gains over a level one, as `table` has gains."""
        levels = set(self.names("level"))
        table = self._table(
            lambda name: self.worth(name, experiment, score) if name in levels else None
        )
        return table.assign(level=False)

    def _table(self, cell: Callable[[str], Cell | None]) -> pd.DataFrame:
        rows = []
        for name, facts in self.conditions.iterrows():
            if (one := cell(name)) is not None:
                found = {end: getattr(one, end) / 100 for end in ("value", "low", "high")}
                frames = self.evidence[name].frames
                rows.append({"condition": name, **facts, "frames": frames, **found})
        return pd.DataFrame(rows)


def is_binned(conditions: pd.DataFrame) -> pd.Series:
    """Which conditions hold for the frames of some tilt alone."""
    return (conditions["tilt_low_deg"] > 0) | (conditions["tilt_high_deg"] < float("inf"))


def _evidence(condition: str, runs: Sequence[ScoredRun]) -> Evidence:
    """Of the runs that were scored under a condition."""
    found: dict[Path, Tally] = {}
    tallies: dict[str, dict[int, Tally]] = {}
    for run in runs:
        path = run.path / ATTITUDE / TALLIES / f"{condition}.npz"
        if not path.is_file():
            raise UserError(f"{path}: is not there; run task=attitude again")
        found[path] = Tally.read(path)
        tallies.setdefault(run.experiment, {})[run.seed] = found[path]
    _require_same_frames(found)
    return Evidence(tallies)


def _require_own(run: ScoredRun) -> None:
    """What was counted under the true attitude is what was counted of the run."""
    path = run.path / ATTITUDE / TALLIES / f"{TRUE}.npz"
    if not path.is_file():
        return
    tally = Tally.read(path)
    # It is of all frames: that part of the split which the run was scored on, by another name.
    protocol = replace(tally.protocol, part=run.tally.protocol.part)
    found = {path: replace(tally, protocol=protocol), run.path: run.tally}
    _require_same_frames(found)
    here, there = (tally.tables["occupancy"]["count"] for tally in found.values())
    moved = float((here - there).abs().sum() / 2 / there.sum())
    if moved > MOVED:
        raise UserError(
            f"{path}: counts {100 * moved:.2g} % of the voxels otherwise than the run; run "
            "task=attitude on the run's best checkpoint again"
        )


def _require_alike(tables: Mapping[Path, pd.DataFrame], conditions: pd.DataFrame) -> None:
    """Conditions of one name are one condition in all runs, and all have the same bins of tilt."""
    bins = {
        path: [name for name in table.index if name.startswith("tilt")]
        for path, table in tables.items()
    }
    for path, names in bins.items():
        first = next(iter(bins))
        if sorted(names) != sorted(bins[first]):
            raise UserError(f"{path}: has other bins of tilt than {first}; {AGAIN}")
    for path, table in tables.items():
        same = table.eq(conditions.loc[table.index])
        for name, key in [(name, key) for name in table.index for key in FACTS]:
            if not same.loc[name, key]:
                raise UserError(
                    f"{path}: {name} has {key}={table.loc[name, key]:g}, and elsewhere "
                    f"{conditions.loc[name, key]:g}; {AGAIN}"
                )


def _require_the_same_of_all_seeds(
    runs: Sequence[ScoredRun], tables: Mapping[Path, pd.DataFrame]
) -> None:
    """A column of a table is of the same seeds as the next one."""
    firsts: dict[str, Path] = {}
    for run, (path, table) in zip(runs, tables.items()):
        first = firsts.setdefault(run.experiment, path)
        if other := set(table.index) ^ set(tables[first].index):
            raise UserError(f"{path}: has other conditions than {first} ({min(other)}); {AGAIN}")


def _require_same_frames(tallies: Mapping[Path, Tally]) -> None:
    require_same_protocol({str(path): tally.protocol for path, tally in tallies.items()})
    (first, reference), *others = tallies.items()
    for path, tally in others:
        if other := tally.scored_on_other(reference):
            raise UserError(f"{path}: was scored on {other} than {first}; {AGAIN}")


def _conditions(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype={"condition": str})
        return table.drop_duplicates("condition").set_index("condition")[FACTS]
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: cannot be read ({reason}); run task=attitude again") from None
