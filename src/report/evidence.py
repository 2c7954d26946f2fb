"""What several experiments scored on the same clips, resampled together."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from ..metrics.intervals import (
    interval_of,
    resamplings,
    score_samples,
    seed_resamplings,
    seed_sample,
)
from ..metrics.safety import BLOCKED
from ..metrics.tally import Tally
from ..ontology import CLASSES
from .report_table import Cell

METRICS = ("occupancy", "safety", "rays")
"""Those of the suite whose scores stand in a report."""
LONG_TAIL = ("thin_structure", "large_vehicle", "car", "vru")
"""The paper's long-tail safety structures; ``long_tail`` is the mean of their IoU."""

Samples = dict[str, Float[Tensor, "1+r"]]


class Evidence:
    """Scores of experiments, each with one or several seeds, on a part of the test split.

    All cells come from the same resamples. Each draws clips with replacement, the same for every
    experiment, and, for experiments with several seeds, seeds with replacement, the same wherever
    there are as many. So what experiments share cancels in their differences.

    Args:
        tallies: of every experiment by its seeds; of one protocol and the same clips.
        chosen: says which clips belong to the part. At least one with a frame must.

    ``labelled_clips`` has, for each class, the number of clips with a voxel of it, ``lost`` the
    share of the resamples that draw none of a class which is there, and ``blocked`` the numbers of
    frames and of clips with something in the tube that the UAV's body sweeps.
    """

    def __init__(
        self,
        tallies: Mapping[str, Mapping[int, Tally]],
        chosen: Callable[[str], bool] = lambda clip: True,
    ) -> None:
        reference = next(iter(next(iter(tallies.values())).values()))
        self.rows = reference.rows(chosen)
        self.frames = sum(reference.frames[row] for row in self.rows)
        settings = reference.protocol.suite
        self.resamples, self.level = settings["resamples"], settings["level"]
        self.generator_seed = settings["seed"]
        self.suite = reference.suite()
        # As for the scores of a single run, so that with one seed the intervals are the same.
        self.weights = resamplings(len(self.rows), self.resamples, self._generator(0))
        self.seed_weights = cache(self._seed_weights)
        self.samples = {
            name: {seed: self._samples(tally) for seed, tally in sorted(by_seed.items())}
            for name, by_seed in tallies.items()
        }
        truth = reference.tables["occupancy"]["count"][self.rows].sum(-1)
        labelled = truth > 0
        self.labelled_clips = dict(zip(CLASSES, labelled.sum(0).tolist()))
        drawn = self.weights @ labelled.to(self.weights) > 0
        self.lost = float((labelled.any(0) & ~drawn).any(1).double().mean())
        self.blocked = _blocked(reference, self.rows)

    @property
    def clips(self) -> int:
        return len(self.rows)

    def seeds(self, experiment: str) -> list[int]:
        """The seeds of an experiment; none of one that is not there."""
        return list(self.samples.get(experiment, {}))

    def value(self, experiment: str, seed: int, score: str) -> float:
        """A score of one run on all clips, in percent; NaN where its suite has none."""
        sample = self.samples[experiment][seed].get(score)
        return float("nan") if sample is None else float(sample[0])

    def has(self, score: str) -> bool:
        """Whether any run has a score."""
        return any(score in run for by_seed in self.samples.values() for run in by_seed.values())

    def cell(self, experiment: str, score: str) -> Cell | None:
        """The mean over an experiment's seeds; ``None`` where it has no such score."""
        return self._cell(
            [self._sample(experiment, seed, score) for seed in self.seeds(experiment)]
        )

    def difference(
        self, experiment: str, reference: str, score: str, other: "Evidence | None" = None
    ) -> Cell | None:
        """The mean change from a reference over the seeds that both have; ``None`` without one.

        The reference's scores are those of the ``other`` evidence, of the same frames predicted
        otherwise, where it is given. Of an experiment from itself the change is 0, and no resample
        says otherwise. Raises `ValueError` where the other one is of other clips.
        """
        theirs = other or self
        if theirs.rows != self.rows:
            raise ValueError(f"clips {self.rows} and {theirs.rows} cannot be paired")
        common = [seed for seed in self.seeds(experiment) if seed in theirs.seeds(reference)]
        if experiment == reference and theirs is self:
            return Cell(0.0, signed=True) if common else None
        pairs = [
            (self._sample(experiment, seed, score), theirs._sample(reference, seed, score))
            for seed in common
        ]
        changes = [None if a is None or b is None else a - b for a, b in pairs]
        return self._cell(changes, signed=True)

    def _cell(self, samples: list[Tensor | None], signed: bool = False) -> Cell | None:
        there = [sample for sample in samples if sample is not None]
        if not there:
            return None
        sample = seed_sample(torch.stack(there), self.seed_weights(len(there)))
        several = len(there) > 1 or self.clips > 1
        return Cell(*interval_of(sample if several else sample[:1], self.level), signed)

    def _sample(self, experiment: str, seed: int, score: str) -> Tensor | None:
        return self.samples[experiment][seed].get(score)

    def _samples(self, tally: Tally) -> Samples:
        """Every score of a run in percent, of all clips and of each resample."""
        found: Samples = {}
        for name in METRICS:
            if name in tally.tables:
                tables = {key: table[self.rows] for key, table in tally.tables[name].items()}
                found |= score_samples(self.suite.metric(name), tables, self.weights)
        found["long_tail"] = torch.stack([found[f"iou/{name}"] for name in LONG_TAIL]).nanmean(0)
        found["gap"] = found["miou"] - found["kar_miou"]
        return {name: 100 * sample for name, sample in found.items()}

    def _seed_weights(self, seeds: int) -> Float[Tensor, "r s"]:
        return seed_resamplings(seeds, self.resamples, self._generator(1))

    def _generator(self, level: int) -> Generator:
        """One stream of random numbers a level: clips and seeds are drawn independently."""
        return Generator().manual_seed(self.generator_seed + level)


def _blocked(tally: Tally, rows: Sequence[int]) -> tuple[int, int]:
    """How many frames have something in the tube that the UAV's body sweeps, and of how many clips
    they are; none where that was not scored."""
    if "safety" not in tally.tables:
        return 0, 0
    frames = tally.tables["safety"]["frames"][rows][:, BLOCKED]
    return int(frames.sum()), int((frames > 0).sum())
