"""Scored runs that may stand in one table: of one protocol and the same labels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import pandas as pd
import torch

from ..errors import UserError
from ..metrics.protocol import require_same_protocol
from ..metrics.suite import STANDARD
from ..results.counts import OTHER_LABELS, Counts, Parts
from ..results.files import SCORES
from ..results.runs import ScoredRun
from ..results.table import Resamples
from ..run_folder import ANCHORS
from ..used_code import different_file
from .ladder import PAPER, Ladder

REPORT_APART = "report them apart, each with its own task.runs"
TOLERANCE = 1e-6
# The share of voxels that runs of one table may label otherwise. Of the same flights made on two
# kinds of processors, which round differently, 3 in a million were (docs/conventions.md).
OTHER_PROCESSOR = 1e-4

# The paper's long-tail safety structures; the score ``long_tail`` is the mean of their IoU.
LONG_TAIL = ("thin_structure", "large_vehicle", "car", "vru")
DERIVED = {
    "long_tail": lambda of: torch.stack([of[f"iou/{name}"] for name in LONG_TAIL]).nanmean(0),
    "gap": lambda of: of["miou"] - of["kar_miou"],
}

# Scores that the paper does not have, their names, and which end of them is the better one.
BEYOND = {
    "miou_occupied": ("mIoU occupied", "high"),
    "geometric_iou": ("Geometric IoU", "high"),
    "ray_iou": ("RayIoU", "high"),
    "primitive_miss": ("Primitive miss", "low"),
    "primitive_auc": ("Primitive AUC", "high"),
    "object_miss_rate": ("Object miss", "low"),
    "plan_regret": ("Plan regret", "low"),
    "collision_miss_rate": ("Collision-miss rate", "low"),
    "false_free_rate": ("False-free rate", "low"),
}

# Metrics whose many scores have tables of their own, and no place in a report.
APART = ("breakdown", "calibration")


@dataclass(frozen=True)
class Part:
    """What a group of runs scored on a part of the test split, and how it was resampled."""

    resamples: Resamples
    ladder: Ladder = PAPER

    @property
    def name(self) -> str:
        return self.resamples.part

    @cached_property
    def scores(self) -> pd.DataFrame:
        """The long table: each experiment, and differences from the lowest rung and the one before.

        Differences of a rung from itself are there too, as zeros in the tables.
        """
        names = self.ladder.names
        references = {
            name: list(dict.fromkeys([names[0], before]))
            for before, name in pairwise([names[0], *names])
        }
        table = self.resamples.table(references)
        return table[table["score"].isin([*SCORES, *BEYOND, *DERIVED, *self.own_scores])]

    @property
    def own_scores(self) -> list[str]:
        """The scores of metrics that are not this project's."""
        of_metrics = self.resamples.scores_of.items()
        return [name for metric, names in of_metrics if metric not in STANDARD for name in names]

    @property
    def rungs(self) -> list[str]:
        """The experiments of the ladder that are there."""
        return [name for name in self.ladder.names if name in self.resamples.samples]

    @property
    def groups(self) -> tuple[list[str], list[str], list[str]]:
        """The experiments by kind: rungs, others by name, and anchors."""
        samples = self.resamples.samples
        others = sorted(samples.keys() - {*self.ladder.names, *ANCHORS})
        return self.rungs, others, [name for name in ANCHORS if name in samples]


@dataclass(frozen=True)
class RunGroup:
    """Runs of one protocol, the ladder's first."""

    runs: tuple[ScoredRun, ...]
    ladder: Ladder = PAPER

    @property
    def rungs(self) -> list[ScoredRun]:
        return [run for run in self.runs if run.experiment in self.ladder]

    def counts(self) -> dict[str, dict[int, Counts]]:
        """Returns those of every experiment by seed, and of each anchor once: it has no seed."""
        counts: dict[str, dict[int, Counts]] = {}
        for run in self.runs:
            counts.setdefault(run.experiment, {})[run.seed] = run.counts
        for anchor in ANCHORS:
            of_runs = [run.anchors[anchor] for run in self.runs if anchor in run.anchors]
            if of_runs:  # the one that was scored with most metrics
                counts[anchor] = {0: max(of_runs, key=lambda each: len(each.tables))}
        return counts

    def parts(self, parts_of: Callable[[Sequence[str]], Parts]) -> list[Part]:
        """Returns the parts of the test split that have a frame, resampled.

        ``parts_of`` gives them for the clips that were never trained on. Raises `UserError` for a
        run whose counts give other scores than its ``results.csv``.
        """
        first, kept = self.runs[0], {"without": APART, "derived": DERIVED}
        parts = [
            Part(Resamples(self.counts(), name, chosen=chosen, **kept), self.ladder)
            for name, chosen in parts_of(first.config["data"]["test_clips"]).items()
            if first.counts.rows(chosen)
        ]

        for run in self.runs:
            written = float(run.row["miou"])
            counted = float(parts[0].resamples.samples[run.experiment][run.seed]["miou"][0])
            if abs(written - counted) > TOLERANCE:
                raise UserError(
                    f"{run.path}: results.csv says mIoU {100 * written:.4f} %, and the counts "
                    f"{100 * counted:.4f} %; they are of two scorings, so run it again"
                )
        return parts


def group_of(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> RunGroup:
    """Returns the runs in the order of the tables.

    Raises `UserError` for runs of other protocols, clips, labels or code, and for two runs of one
    experiment and seed.
    """
    for first, run in combinations(runs, 2):
        _require_same_code(first, run)
    try:
        require_same_protocol({str(run.path): run.counts.protocol for run in runs})
    except UserError as error:
        raise UserError(f"{error}, or {REPORT_APART}") from None

    by_key: dict[tuple[str, int], ScoredRun] = {}
    for run in runs:
        other = run.counts.scored_on_other(runs[0].counts)
        unlike = run.counts.unlike_labels(runs[0].counts) if other == OTHER_LABELS else 1
        if other and unlike > OTHER_PROCESSOR:
            raise UserError(
                f"{run.path}: was scored on {other} than {runs[0].path}; score both alike, or "
                f"{REPORT_APART}"
            )
        if (same := by_key.setdefault((run.experiment, run.seed), run)) is not run:
            raise UserError(
                f"{run.path} and {same.path}: both are {run}; name one of them in task.runs"
            )

    order = ladder.in_order(run.experiment for run in runs)
    ordered = sorted(runs, key=lambda run: (order.index(run.experiment), run.seed))
    return RunGroup(tuple(ordered), ladder)


def _require_same_code(first: ScoredRun, run: ScoredRun) -> None:
    """Refuses runs that were trained by other code, in the files that both of them used."""
    shared = first.files.keys() & run.files.keys()
    unlike = any(first.files[file] != run.files[file] for file in shared)
    if unlike or not (shared or first.files == run.files):
        file = different_file(first.files, run.files)
        where = f" ({file} differs)" if file else ""
        raise UserError(
            f"{run.path}: was trained by {run.code}, and {first.path} by {first.code}{where}; "
            f"train both by the same, or {REPORT_APART}"
        )
