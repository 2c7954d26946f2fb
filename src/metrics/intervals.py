"""Confidence intervals by resampling clips.

Frames of one clip show the same street in the same light, so they are no independent evidence:
clips are drawn, with replacement, and all frames of a clip come or go together (the cluster
bootstrap). Of two runs on the same clips the same clips are drawn, so what they share cancels.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from ..errors import UserError
from .tables import Scores, TableMetric, Tables

RESAMPLES = 2000
LEVEL = 0.95


class Interval(NamedTuple):
    """A score of all clips, and the bounds between which the scores of resampled clips lie."""

    value: float
    low: float
    high: float


class Difference(NamedTuple):
    """A score of the second run minus the first's, its bounds, and ``same_sign``: the share of
    resamples in which the difference has the sign of ``value``."""

    value: float
    low: float
    high: float
    same_sign: float


def resamplings(clips: int, resamples: int, generator: Generator) -> Float[Tensor, "r n"]:
    """How often each of n clips is drawn in each of r resamples of n clips."""
    if clips < 1 or resamples < 1:
        raise UserError(f"resamples: cannot draw {resamples} times from {clips} clips")
    drawn = torch.randint(clips, (resamples, clips), generator=generator)
    weights = torch.zeros(resamples, clips, dtype=torch.float64)
    return weights.scatter_add_(1, drawn, torch.ones_like(weights))


def score_intervals(
    metric: TableMetric,
    tables: Tables,
    weights: Float[Tensor, "r n"],
    level: float = LEVEL,
) -> dict[str, Interval]:
    """Every score of the tables [n clips, ...], with its percentile interval.

    With one clip there is nothing to resample: the bounds are NaN. So they are where a score is NaN
    in all resamples; resamples in which it is are left out.
    """
    values, resampled = _whole(metric, tables), _resampled(metric, tables, weights)
    intervals = {}
    for name, value in values.items():
        low, high = _bounds(resampled[name], level) if weights.shape[1] > 1 else (torch.nan,) * 2
        intervals[name] = Interval(float(value), float(low), float(high))
    return intervals


def score_differences(
    metric: TableMetric,
    first: Tables,
    second: Tables,
    weights: Float[Tensor, "r n"],
    level: float = LEVEL,
) -> dict[str, Difference]:
    """Every score of the second tables minus the first's, both [n clips, ...] of the same clips."""
    differences = {}
    values = [_whole(metric, tables) for tables in (first, second)]
    resampled = [_resampled(metric, tables, weights) for tables in (first, second)]
    for name in values[0]:
        value = values[1][name] - values[0][name]
        drawn = resampled[1][name] - resampled[0][name]
        several = weights.shape[1] > 1
        low, high = _bounds(drawn, level) if several else (torch.nan,) * 2
        kept = drawn[~drawn.isnan()]
        same = (kept.sign() == value.sign()).double().mean() if several else torch.nan
        differences[name] = Difference(float(value), float(low), float(high), float(same))
    return differences


def _whole(metric: TableMetric, tables: Tables) -> Scores:
    return metric.scores({name: table.sum(0) for name, table in tables.items()})


def _resampled(metric: TableMetric, tables: Tables, weights: Float[Tensor, "r n"]) -> Scores:
    return metric.scores(
        {
            name: (weights @ table.flatten(1).double()).unflatten(1, table.shape[1:])
            for name, table in tables.items()
        }
    )


def _bounds(values: Float[Tensor, "r"], level: float) -> tuple[Tensor, Tensor]:
    kept = values[~values.isnan()]
    if not len(kept):
        return values.new_tensor(torch.nan), values.new_tensor(torch.nan)
    tail = (1 - level) / 2
    return tuple(kept.quantile(kept.new_tensor([tail, 1 - tail])))
