"""Conditions under which task=attitude presents the test split, and what it has counted there."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import combinations, pairwise
from pathlib import Path

import pandas as pd
import torch
from jaxtyping import Bool
from torch import Tensor

from src.data.batch import Batch
from src.errors import UserError
from src.results.counts import Counts, require_comparable
from src.results.runs import ScoredRun
from src.run_folder import TALLIES
from studies.attitude.measured_poses import Fault

# The folder of task=attitude in a run's folder, and its table.
ATTITUDE, TABLE = "attitude", "attitude.csv"

# The condition of frames that are presented with their true attitude, and with that of a UAV that
# flies level.
TRUE, LEVEL = "true", "level"

# Columns that older tables lack: nothing was off.
LATER = ("distance_off", "time_off_s")

# Share of the voxels that another machine, or another batch, may tip. Two seeds of a rung, even
# where their mIoU is the same, differ in ten times as many and more.
MOVED = 1e-4
AGAIN = "score both alike with task=attitude"

# Counts of the experiments by seed, under each condition.
Conditions = dict["Condition", dict[str, dict[int, Counts]]]


@dataclass(frozen=True)
class Condition:
    """Frames with a tilt from ``tilt_low_deg`` on and below ``tilt_high_deg``, and how they are
    presented: with poses that have a `Fault`, whose fields these are.

    The tilt is |roll| + |pitch| of the true attitude. Its fields are columns of ``attitude.csv``.
    """

    tilt_low_deg: float = 0.0
    tilt_high_deg: float = math.inf
    noise_deg: float = 0.0
    delay_s: float = 0.0
    level: bool = False
    distance_off: float = 0.0
    time_off_s: float = 0.0

    @property
    def fault(self) -> Fault:
        """What is wrong with the poses that the model is given."""
        return Fault(**{each.name: getattr(self, each.name) for each in fields(Fault)})

    @property
    def presented(self) -> str:
        """The column ``condition`` of the long table: true, noise_3deg, delay_0.2s, distance_2pct,
        time_0.01s or level."""
        parts = [f"noise_{self.noise_deg:g}deg"] if self.noise_deg else []
        parts += [f"delay_{self.delay_s:g}s"] if self.delay_s else []
        parts += [f"distance_{100 * self.distance_off:g}pct"] if self.distance_off else []
        parts += [f"time_{self.time_off_s:g}s"] if self.time_off_s else []
        return "_".join(parts + [LEVEL] * self.level) or TRUE

    @property
    def part(self) -> str:
        """The column ``part`` of the long table: the whole test split, or a bin of tilt."""
        return f"tilt_{self.tilt_low_deg:g}_{self.tilt_high_deg:g}deg" if self.is_bin else "test"

    @property
    def is_bin(self) -> bool:
        return self.tilt_low_deg > 0 or self.tilt_high_deg < math.inf

    @property
    def name(self) -> str:
        """The name for files: true, tilt_5_10deg, noise_3deg, level or level_tilt_5_10deg."""
        if not self.is_bin:
            return self.presented
        return self.part if self.presented == TRUE else f"{self.presented}_{self.part}"

    def holds(self, batch: Batch) -> Bool[Tensor, "b"]:
        """Returns a mask of the frames of a batch, with its true attitude, that belong here."""
        tilt_deg = torch.rad2deg(batch["attitude_rad"].abs().sum(dim=-1))
        return (tilt_deg >= self.tilt_low_deg) & (tilt_deg < self.tilt_high_deg)


def conditions_of(
    tilt_edges_deg: Sequence[float],
    noise_deg: Sequence[float],
    delay_s: Sequence[float],
    level: bool,
    distance_off: Sequence[float] = (),
    time_off_s: Sequence[float] = (),
) -> Iterator[Condition]:
    """Yields all frames; each bin of tilt; all frames under each fault, one at a time.

    With ``level``, all frames and each bin follow once more, as of a UAV that flies level. Raises
    `UserError` for edges that do not ascend from above zero, for values that are not above zero,
    and for two that have one name.
    """
    edges = [0.0, *tilt_edges_deg]
    if any(not high > low for low, high in pairwise(edges)):
        raise UserError(f"task.tilt_edges_deg: {list(tilt_edges_deg)}; give ascending ones above 0")
    faults = {"noise_deg": noise_deg, "delay_s": delay_s}
    faults |= {"distance_off": distance_off, "time_off_s": time_off_s}
    for name, values in {"tilt_edges_deg": tilt_edges_deg, **faults}.items():
        if any(not 0 < value < math.inf for value in values):
            raise UserError(f"task.{name}: {list(values)}; give values above 0")
        if len({f"{value:g}" for value in values}) < len(values):
            raise UserError(f"task.{name}: {list(values)}; give values of which no two are alike")

    bins = [Condition()]
    if len(edges) > 1:
        bins += [Condition(*bounds) for bounds in zip(edges, [*edges[1:], math.inf])]
    yield from bins
    for name, values in faults.items():
        yield from (Condition(**{name: value}) for value in values)
    if level:
        yield from (replace(condition, level=True) for condition in bins)


def condition_table(conditions: Sequence[Condition], noise_seed: int) -> pd.DataFrame:
    """Returns the columns of ``attitude.csv`` that are no scores, a row a condition."""
    rows = [{"condition": each.name, **asdict(each)} for each in conditions]
    return pd.DataFrame(rows).assign(noise_seed=noise_seed)


def read_conditions(runs: Sequence[ScoredRun]) -> Conditions:
    """Reads what task=attitude has counted of the runs that it has scored.

    The true poses come first, then their bins of tilt, noise, delay, distances, times, and level
    flight; each of them ascends. Raises `UserError` for counts that cannot be read, or that are not
    of the same frames under the same conditions.
    """
    tables = [(run, _facts(run)) for run in runs if (run.path / ATTITUDE / TABLE).is_file()]
    _require_alike(tables)

    conditions: Conditions = {}
    firsts: dict[Condition, tuple[Path, Counts]] = {}
    for run, table in tables:
        for name, facts in table.drop(columns="noise_seed").to_dict("index").items():
            condition, path = Condition(**facts), run.path / ATTITUDE / TALLIES / f"{name}.npz"
            if not path.is_file():
                raise UserError(f"{path}: is not there; run task=attitude again")
            counts = Counts.read(path)
            if condition == Condition():
                _require_own(run, path, counts)
            first, of_first = firsts.setdefault(condition, (path, counts))
            require_comparable({str(first): of_first, str(path): counts}, AGAIN)
            by_experiment = conditions.setdefault(condition, {})
            by_experiment.setdefault(run.experiment, {})[run.seed] = counts
    return {each: conditions[each] for each in sorted(conditions, key=_order)}


def _order(condition: Condition) -> tuple:
    faults = condition.time_off_s, condition.distance_off, condition.delay_s, condition.noise_deg
    return condition.level, *faults, condition.tilt_low_deg, -condition.tilt_high_deg


def _facts(run: ScoredRun) -> pd.DataFrame:
    """Reads the facts of a run's conditions, a row by the name of each."""
    path = run.path / ATTITUDE / TABLE
    try:
        table = pd.read_csv(path, dtype={"condition": str})
        table = table.assign(**{name: 0.0 for name in LATER if name not in table})
        facts = [*(each.name for each in fields(Condition)), "noise_seed"]
        return table.drop_duplicates("condition").set_index("condition")[facts]
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: cannot be read ({reason}); run task=attitude again") from None


def _require_alike(tables: Sequence[tuple[ScoredRun, pd.DataFrame]]) -> None:
    """Raises `UserError` where runs have other bins of tilt, seeds of one experiment other
    conditions, or conditions of one name other facts: columns of a table would not be of one kind.
    """
    for (first, of_first), (run, table) in combinations(tables, 2):
        path, other = run.path / ATTITUDE / TABLE, first.path / ATTITUDE / TABLE
        lacking = table.index.symmetric_difference(of_first.index)
        if lacking.str.startswith("tilt").any():
            raise UserError(f"{path}: has other bins of tilt than {other}; {AGAIN}")
        if len(lacking) and run.experiment == first.experiment:
            raise UserError(f"{path}: has other conditions than {other} ({min(lacking)}); {AGAIN}")

        for name in table.index.intersection(of_first.index):
            for key, before in of_first.loc[name].items():
                if (value := table.loc[name, key]) != before:
                    raise UserError(
                        f"{path}: {name} has {key}={float(value):g}, and elsewhere "
                        f"{float(before):g}; {AGAIN}"
                    )


def _require_own(run: ScoredRun, path: Path, counts: Counts) -> None:
    """Raises `UserError` where the true attitude was counted unlike the run itself."""
    # Its part has another name, but all frames are those that the run was scored on.
    protocol = replace(counts.protocol, part=run.counts.protocol.part)
    mine = replace(counts, protocol=protocol)
    require_comparable({str(path): mine, str(run.path): run.counts}, AGAIN)

    table, own = (each.tables["occupancy"]["count"] for each in (counts, run.counts))
    moved = float((table - own).abs().sum() / 2 / own.sum())
    if moved > MOVED:
        raise UserError(
            f"{path}: counts {100 * moved:.2g} % of the voxels otherwise than the run; run "
            "task=attitude on the run's best checkpoint again"
        )
