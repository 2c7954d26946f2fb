"""The one long table of results: a row for each experiment, seed, condition, part and score."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, cached_property
from itertools import product

import pandas as pd
import torch
from jaxtyping import Bool, Float
from torch import Generator, Tensor

from ..metrics.safety import BLOCKED
from ..ontology import CLASSES
from .bootstrap import Samples, interval_of, resamplings, seed_resamplings, seed_sample
from .counts import Counts
from .files import AS_RECORDED, LONG_KEYS, LONG_VALUES
from .render import Cell, Row

# The last two are empty for a score. Of a difference they say from what: from another experiment,
# or from the same one under another condition.
KEYS = (*LONG_KEYS, "reference", "reference_condition")
COLUMNS = (*KEYS, *LONG_VALUES)
# In the column ``seed``: the mean over all seeds of an experiment.
MEAN = "mean"
# Scores that are made of others, as a mean of some classes.
Derived = Mapping[str, Callable[[Samples], Tensor]]


class Resamples:
    """Scores of experiments, each with one or several seeds, on the same resamples of some clips.

    Each resample draws clips with replacement, the same for every experiment, and, for experiments
    with several seeds, seeds with replacement, the same wherever there are as many. So what
    experiments share cancels in their differences.

    Args:
        counts: of every experiment by its seeds; of one protocol and the same clips.
        part: the name of the part of the test split that is scored, for the long table.
        condition: how its frames were presented, for the long table.
        chosen: says which clips belong to the part. At least one with a frame must.
        without: metrics whose scores are left out.
        derived: further scores, computed from the samples of the others.

    ``scores_of`` has the names of each metric's scores.
    """

    def __init__(
        self,
        counts: Mapping[str, Mapping[int, Counts]],
        part: str = "test",
        condition: str = AS_RECORDED,
        chosen: Callable[[str], bool] = lambda clip: True,
        without: Collection[str] = (),
        derived: Derived | None = None,
    ) -> None:
        self.first = next(iter(next(iter(counts.values())).values()))
        self.part, self.condition, self.rows = part, condition, self.first.rows(chosen)
        self.clips = len(self.rows)
        self.frames = sum(self.first.frames[row] for row in self.rows)
        settings = self.first.protocol.suite
        self.resamples, self.level = settings["resamples"], settings["level"]

        # One stream of random numbers a level: clips and seeds are drawn independently.
        of_clips, of_seeds = (settings["seed"] + level for level in (0, 1))
        clips = Generator().manual_seed(of_clips)
        self.weights = resamplings(self.clips, self.resamples, clips)
        self.seed_weights = cache(
            lambda n: seed_resamplings(n, self.resamples, Generator().manual_seed(of_seeds))
        )

        self.scores_of: dict[str, list[str]] = {}
        self.samples: dict[str, dict[int, Samples]] = {}
        for name, by_seed in counts.items():
            for seed, each in sorted(by_seed.items()):
                by_metric = each.samples(self.rows, self.weights, without)
                self.scores_of |= {metric: list(scores) for metric, scores in by_metric.items()}
                samples = {name: s for scores in by_metric.values() for name, s in scores.items()}
                samples |= {name: score(samples) for name, score in (derived or {}).items()}
                self.samples.setdefault(name, {})[seed] = samples
        self.protocols = {
            # How an experiment was scored is one for all its seeds.
            name: next(iter(by_seed.values())).protocol.digest
            for name, by_seed in counts.items()
        }
        self.recipes = {
            name: ", ".join(dict.fromkeys(each.recipe for each in by_seed.values()))
            for name, by_seed in counts.items()
        }

    @cached_property
    def labelled_clips(self) -> dict[str, int]:
        """The number of clips with a labelled voxel of each class."""
        return dict(zip(CLASSES, self._labelled.sum(0).tolist()))

    @cached_property
    def lost(self) -> float:
        """The share of the resamples that draw no voxel of a class which is there."""
        drawn = self.weights @ self._labelled.to(self.weights) > 0
        return float((self._labelled.any(0) & ~drawn).any(1).double().mean())

    @cached_property
    def blocked(self) -> tuple[int, int]:
        """The number of frames with something in the tube that the body sweeps, and of their clips.

        Both are 0 where that was not scored.
        """
        if "safety" not in self.first.tables:
            return 0, 0
        frames = self.first.tables["safety"]["frames"][self.rows][:, BLOCKED]
        return int(frames.sum()), int((frames > 0).sum())

    @property
    def _labelled(self) -> Bool[Tensor, "n 9"]:
        # Labels are what remains of the counts when the predictions are summed away.
        return self.first.tables["occupancy"]["count"][self.rows].sum(-1) > 0

    def seeds(self, experiment: str) -> list[int]:
        """Returns the seeds of an experiment; none of one that is not there."""
        return list(self.samples.get(experiment, {}))

    def mean(self, experiment: str, score: str) -> Float[Tensor, "1+r"] | None:
        """Returns the mean over an experiment's seeds; ``None`` where it has no such score."""
        return self.combined({experiment: 1.0}, score)

    def change(
        self, experiment: str, reference: str, score: str, other: "Resamples | None" = None
    ) -> Float[Tensor, "1+r"] | None:
        """Returns the mean change from a reference over the seeds that both have.

        With ``other`` the reference's scores are those of the same frames under another condition.
        The result is ``None`` where there is no pair. An experiment differs from itself by 0, and
        no resample says otherwise. Raises `ValueError` where the other clips are not the same.
        """
        of_reference = other or self
        if of_reference.rows != self.rows:
            raise ValueError(f"clips {self.rows} and {of_reference.rows} cannot be paired")

        own = self.samples.get(experiment, {})
        references = of_reference.samples.get(reference, {})
        if own is references:
            return torch.zeros(1, dtype=torch.float64)
        return self._mean([(1.0, own), (-1.0, references)], score)

    def combined(self, weights: Mapping[str, float], score: str) -> Float[Tensor, "1+r"] | None:
        """Returns a weighted sum of experiments, over the seeds that all of them have; ``None``
        where there is none. What they share in a resample cancels where the weights add up to 0.
        """
        terms = [(weight, self.samples.get(name, {})) for name, weight in weights.items()]
        return self._mean(terms, score)

    def table(self, references: Mapping[str, Sequence[str]] | None = None) -> pd.DataFrame:
        """Returns the rows of every seed, of the means, and of the differences from references."""
        rows = []
        for experiment, by_seed in self.samples.items():
            for seed, samples in by_seed.items():
                for score in samples:
                    sample = self._mean([(1.0, {seed: samples})], score)
                    rows.append(self._row(experiment, str(seed), score, sample))
            for score in self._scores(experiment):
                rows.append(self._row(experiment, MEAN, score, self.mean(experiment, score)))
        scores = pd.DataFrame(rows, columns=list(COLUMNS))
        return joined([scores, self.table_of_changes(references or {})])

    def table_of_changes(
        self, references: Mapping[str, Sequence[str]], other: "Resamples | None" = None
    ) -> pd.DataFrame:
        """Returns the rows of the differences from references, as `change` has them."""
        condition, rows = other.condition if other else "", []
        for experiment, names in references.items():
            for reference, score in product(names, self._scores(experiment)):
                sample = self.change(experiment, reference, score, other)
                if sample is not None:
                    rows += [self._row(experiment, MEAN, score, sample, reference, condition)]
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def _scores(self, experiment: str) -> list[str]:
        """Returns the names of the scores that any seed has, in their order."""
        by_seed = self.samples.get(experiment, {})
        return list(dict.fromkeys(score for samples in by_seed.values() for score in samples))

    def _row(
        self, experiment: str, seed: str, score: str, sample: Tensor, *references: str
    ) -> tuple:
        key = (experiment, seed, self.condition, self.part, score, *(references or ("", "")))
        facts = self.clips, self.frames, self.protocols[experiment], self.recipes[experiment]
        return (*key, *interval_of(sample, self.level), *facts)

    def _mean(
        self, terms: Sequence[tuple[float, Mapping[int, Samples]]], score: str
    ) -> Float[Tensor, "1+r"] | None:
        """Returns the mean of a weighted sum over the seeds that all of its terms have."""
        _, first = terms[0]
        seeds = [seed for seed in first if all(score in of.get(seed, {}) for _, of in terms)]
        if not seeds:
            return None
        sums = [sum(weight * of[seed][score] for weight, of in terms) for seed in seeds]
        sample = seed_sample(torch.stack(sums), self.seed_weights(len(sums)))
        # One seed on one clip leaves nothing to draw: the score stands alone, without bounds.
        return sample if len(sums) > 1 or self.clips > 1 else sample[:1]


def joined(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Returns the rows of all tables, which may be none, in their order."""
    filled = [table for table in tables if len(table)]
    return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=list(COLUMNS))


def pivoted(
    table: pd.DataFrame,
    rows: Sequence[tuple[str, Mapping[str, str]]],
    columns: Sequence[Mapping[str, str]],
) -> list[Row]:
    """Returns means over seeds of a long table as the named rows of a small one, in percent.

    Each row and each column says which values of `KEYS` it shows; where both do, the row counts.
    What they leave out is that of a score of the whole split as it was recorded. A cell without a
    row in the long table is ``None``.
    """
    numbers = table[table["seed"] == MEAN].set_index(list(KEYS))[["value", "low", "high"]]
    intervals = dict(zip(numbers.index, numbers.itertuples(index=False)))
    default = {"seed": MEAN, "condition": AS_RECORDED, "part": "test"}
    default |= {"reference": "", "reference_condition": ""}

    def cell(key: Mapping[str, str]) -> Cell | None:
        interval = intervals.get(tuple(key[name] for name in KEYS))
        if interval is None:
            return None
        return Cell(*(100 * number for number in interval), signed=key["reference"] != "")

    return [
        (name, [cell({**default, **column, **row}) for column in columns]) for name, row in rows
    ]
