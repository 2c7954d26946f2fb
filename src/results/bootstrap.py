"""Confidence intervals by resampling clips and, where there are several, the seeds of the training.

Frames of one clip show the same street in the same light, so they are no independent evidence:
clips are drawn, with replacement, and all frames of a clip come or go together (the cluster
bootstrap). Two runs on the same clips are scored on the same drawn clips, so what they share
cancels in their difference.

Another training would have moved a score too. Where a model was trained from several seeds, its
score is their mean, and every resample draws seeds, with replacement, beside its clips: each drawn
seed is scored on the drawn clips (two levels, crossed, since all seeds are scored on all clips).
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from ..errors import UserError
from ..metrics.count_metric import CountMetric, NamedCounts

LEVEL = 0.95
# Scores by their names: each of all clips, and then of each resample.
Samples = dict[str, Float[Tensor, "1+r"]]


class Interval(NamedTuple):
    """A score of all clips, and the bounds between which the scores of resampled clips lie."""

    value: float
    low: float
    high: float


def resamplings(clips: int, resamples: int, generator: Generator) -> Float[Tensor, "r n"]:
    """Returns the number of times that each of n clips is drawn, in r resamples of n clips."""
    if clips < 1 or resamples < 1:
        raise UserError(f"resamples: cannot draw {resamples} times from {clips} clips")

    drawn = torch.randint(clips, (resamples, clips), generator=generator)
    weights = torch.zeros(resamples, clips, dtype=torch.float64)
    return weights.scatter_add_(1, drawn, torch.ones_like(weights))


def seed_resamplings(seeds: int, resamples: int, generator: Generator) -> Float[Tensor, "r s"]:
    """Returns how often each of s seeds is drawn in each of r resamples of s seeds.

    Where the seeds are so few that there are no more ways to draw them than resamples, all ways
    come equally often, in random order: chance would draw one of three seeds three times in 51
    resamples of 1000, and another in 30, where 37 are due.
    """
    ways = seeds**seeds
    if ways > resamples:
        return resamplings(seeds, resamples, generator)

    drawn = torch.cartesian_prod(*[torch.arange(seeds)] * seeds).view(ways, seeds)
    weights = torch.nn.functional.one_hot(drawn, seeds).sum(1).double()
    # Chance decides which of the ways come once more than the others, too.
    turn = torch.randperm(ways, generator=generator)[torch.arange(resamples) % ways]
    return weights[turn[torch.randperm(resamples, generator=generator)]]


def score_samples(
    metric: CountMetric, counts: NamedCounts, weights: Float[Tensor, "r n"]
) -> Samples:
    """Returns every score of the counts [n clips, ...], whole and resampled."""
    whole = metric.scores({name: each.sum(0) for name, each in counts.items()})
    drawn = metric.scores(
        {
            name: (weights @ each.flatten(1).double()).unflatten(1, each.shape[1:])
            for name, each in counts.items()
        }
    )

    # The whole is summed as integers: it is the score of the result table to the last bit.
    return {name: torch.cat([value.view(1), drawn[name]]) for name, value in whole.items()}


def seed_sample(
    samples: Float[Tensor, "s 1+r"], weights: Float[Tensor, "r s"]
) -> Float[Tensor, "1+r"]:
    """Returns the mean of one score over s seeds, and over those that each resample draws.

    ``samples`` are of the same draws of clips, ``weights`` say how often each seed is drawn
    (`seed_resamplings`). A seed whose score is NaN is left out of its mean.
    """
    times = torch.cat([torch.ones_like(weights[:1]), weights]).T
    kept = times * ~samples.isnan()
    return (kept * samples.nan_to_num()).sum(0) / kept.sum(0)


def interval_of(sample: Float[Tensor, "1+r"], level: float = LEVEL) -> Interval:
    """Returns a score and its percentile interval.

    Resamples in which the score is NaN are left out; where none is left, the bounds are NaN.
    """
    value, drawn = sample[0], sample[1:]
    kept = drawn[~drawn.isnan()]
    if not len(kept):
        return Interval(float(value), torch.nan, torch.nan)

    tail = (1 - level) / 2
    low, high = kept.quantile(kept.new_tensor([tail, 1 - tail])).tolist()
    return Interval(float(value), low, high)


def same_sign(sample: Float[Tensor, "1+r"]) -> float:
    """Returns the share of the resamples in which a difference has the sign of the whole; those in
    which it is NaN are left out."""
    value, drawn = sample[0], sample[1:]
    return float((drawn[~drawn.isnan()].sign() == value.sign()).double().mean())
