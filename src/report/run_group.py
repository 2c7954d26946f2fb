"""Scored runs that may stand in one table: of one protocol and the same labels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import UserError
from ..metrics.protocol import require_same_protocol
from ..metrics.tally import Tally
from ..provenance import different_file
from .evidence import Evidence
from .ladder import ANCHORS, PAPER, Ladder
from .scored_part import ScoredPart
from .scored_runs import ScoredRun
from .scores import Parts

MIXED = "task.mixed=true"
TOLERANCE = 1e-6


@dataclass(frozen=True)
class RunGroup:
    """Runs of one protocol, the ladder's first. ``label`` says, in the rows of a further group of
    a mixed report, in what it differs from the first one."""

    runs: tuple[ScoredRun, ...]
    label: str = ""
    ladder: Ladder = PAPER

    @property
    def rungs(self) -> list[ScoredRun]:
        return [run for run in self.runs if run.experiment in self.ladder]

    def tallies(self) -> dict[str, dict[int, Tally]]:
        """Those of every experiment by seed, and of each anchor once: it has no seed."""
        tallies: dict[str, dict[int, Tally]] = {}
        for run in self.runs:
            tallies.setdefault(run.experiment, {})[run.seed] = run.tally
        for anchor in ANCHORS:
            found = [run.anchors[anchor] for run in self.runs if anchor in run.anchors]
            tallies |= {anchor: {0: found[0]}} if found else {}
        return tallies

    def scored_parts(self, parts_of: Callable[[Sequence[str]], Parts]) -> list[ScoredPart]:
        """The parts of the test split that have a frame, resampled.

        ``parts_of`` gives them for the clips that were never trained on. Raises `UserError` for a
        run whose tallies give other scores than its ``results.csv``.
        """
        first, tallies = self.runs[0], self.tallies()
        parts = parts_of(first.config["data"]["test_clips"])
        found = [
            ScoredPart(
                name,
                first.tally.protocol.dataset,
                Evidence(tallies, chosen),
                self.label,
                self.ladder,
            )
            for name, chosen in parts.items()
            if first.tally.rows(chosen)
        ]
        for run in self.runs:
            written = 100 * run.row["miou"]
            counted = found[0].evidence.value(run.experiment, run.seed, "miou")
            if abs(written - counted) > 100 * TOLERANCE:
                raise UserError(
                    f"{run.path}: results.csv says mIoU {written:.4f} %, and the tallies "
                    f"{counted:.4f} %; they are of two scorings, so run it again"
                )
        return found


def groups_of(runs: Sequence[ScoredRun], mixed: bool, ladder: Ladder = PAPER) -> list[RunGroup]:
    """The runs by what they were scored on, the group with most rungs first.

    Unless ``mixed`` there is one. Raises `UserError` for runs of other protocols, clips, labels or
    code then, and always for two runs of one experiment and seed.
    """
    if not mixed:
        _require_same_code(runs)
        _require_same_protocol(runs)
    groups: list[list[ScoredRun]] = []
    for run in runs:
        group = next((group for group in groups if not _difference(group[0], run)), None)
        if group is None:
            groups.append(group := [])
        group.append(run)
    groups.sort(key=lambda group: -sum(run.experiment in ladder for run in group))
    if not mixed and len(groups) > 1:
        first, second = groups[0][0], groups[1][0]
        raise UserError(
            f"{second.path}: was scored on {_difference(first, second)} than {first.path}; score "
            f"both alike, or set {MIXED}"
        )
    return [
        RunGroup(
            _sorted(group, ladder),
            f" ({n}: {_difference(groups[0][0], group[0])})" if n > 1 else "",
            ladder,
        )
        for n, group in enumerate(groups, start=1)
    ]


def _require_same_code(runs: Sequence[ScoredRun]) -> None:
    for run in runs[1:]:
        if run.code != runs[0].code:
            file = different_file(run.files, runs[0].files)
            where = f" (src/{file} differs)" if file else ""
            raise UserError(
                f"{run.path}: was trained by {run.code}, and {runs[0].path} by "
                f"{runs[0].code}{where}; train both by the same, or set {MIXED}"
            )


def _require_same_protocol(runs: Sequence[ScoredRun]) -> None:
    try:
        require_same_protocol({str(run.path): run.tally.protocol for run in runs})
    except UserError as error:
        raise UserError(f"{error}, or set {MIXED}") from None


def _difference(first: ScoredRun, second: ScoredRun) -> str:
    """In what two runs were scored unlike; empty where they may stand in one table."""
    one, other = first.tally, second.tally
    if found := one.protocol.difference(other.protocol):
        key, _, value = found
        return f"{key}={value}"
    return other.scored_on_other(one)


def _sorted(runs: Sequence[ScoredRun], ladder: Ladder) -> tuple[ScoredRun, ...]:
    """In the order of the tables. Raises `UserError` for two of one experiment and seed."""
    found: dict[tuple[str, int], ScoredRun] = {}
    for run in runs:
        other = found.setdefault((run.experiment, run.seed), run)
        if other is not run:
            raise UserError(
                f"{run.path} and {other.path}: both are {run}; name one of them in task.runs"
            )
    order = ladder.in_order(run.experiment for run in runs)
    return tuple(sorted(found.values(), key=lambda run: (order.index(run.experiment), run.seed)))
