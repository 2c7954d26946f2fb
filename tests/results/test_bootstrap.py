"""Intervals by resampling clips and seeds: exact cases, their coverage, and paired differences."""

import math

import pytest
import torch

from src.errors import UserError
from src.metrics.count_metric import CountMetric
from src.results.bootstrap import (
    interval_of,
    resamplings,
    same_sign,
    score_samples,
    seed_resamplings,
    seed_sample,
)


class HitRate(CountMetric):
    """Hits over voxels."""

    def __init__(self):
        super().__init__({"hits": (1,), "voxels": (1,)})

    def frame_counts(self, hits, voxels):
        return {"hits": hits[:, None], "voxels": voxels[:, None]}

    def scores(self, tables):
        hits, voxels = (tables[name][..., 0].double() for name in ("hits", "voxels"))
        return {"rate": hits / voxels}


def rng(seed):
    return torch.Generator().manual_seed(seed)


def clips_of(hits, voxels):
    return HitRate().frame_counts(torch.as_tensor(hits), torch.as_tensor(voxels))


def drawn_clips(clips, generator):
    """Clips of 50 to 150 voxels, of which a share drawn anew for each is hit: 0.6 on average."""
    voxels = torch.randint(50, 151, (clips,), generator=generator)
    share = 0.3 + 0.6 * torch.rand(clips, generator=generator)
    return clips_of(torch.round(share * voxels).long(), voxels)


def drawn(times):
    """The number of every clip or seed as often as it was drawn."""
    return [n for n, often in enumerate(times.long().tolist()) for _ in range(often)]


def rate_of_drawn(tables, clips):
    hits, voxels = (sum(int(tables[name][n]) for n in clips) for name in ("hits", "voxels"))
    return hits / voxels


def rate_difference(first, second, weights):
    """The difference of two rates, its bounds, and the share of the resamples of its sign."""
    one, other = (score_samples(HitRate(), tables, weights)["rate"] for tables in (first, second))
    return *interval_of(other - one), same_sign(other - one)


def rate(tables, seed=0, resamples=500, level=0.95):
    weights = resamplings(len(tables["hits"]), resamples, rng(seed))
    return interval_of(score_samples(HitRate(), tables, weights)["rate"], level)


def mean_of_seeds(*runs):
    """The mean rate over runs on two clips or more, resampled, and the draws of the runs."""
    clips = resamplings(len(runs[0]["hits"]), 2000, rng(0))
    seeds = seed_resamplings(len(runs), 2000, rng(1))
    samples = [score_samples(HitRate(), tables, clips)["rate"] for tables in runs]
    return seed_sample(torch.stack(samples), seeds), seeds


# ---------------------------------------------------------------------------------- resampling


@pytest.mark.parametrize("draw", [resamplings, seed_resamplings])
@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 10])
def test_each_is_drawn_once_on_average_with_the_variance_of_a_binomial(draw, number):
    weights = draw(number, 20_000, rng(0))
    assert (weights.shape, weights.dtype) == ((20_000, number), torch.float64)
    assert (weights.sum(1) == number).all()
    assert torch.equal(weights, weights.round())
    assert weights.min() >= 0
    torch.testing.assert_close(weights.mean(0), torch.ones(number).double(), atol=0.04, rtol=0)
    variance = torch.full((number,), 1 - 1 / number).double()
    torch.testing.assert_close(weights.var(0), variance, atol=0.06, rtol=0)


@pytest.mark.parametrize(("clips", "resamples"), [(0, 10), (5, 0), (-1, 10)])
def test_nothing_to_draw_is_refused(clips, resamples):
    with pytest.raises(UserError, match=r"^resamples:"):
        resamplings(clips, resamples, rng(0))


# ----------------------------------------------------------------------------------- intervals


@pytest.mark.parametrize(("level", "least", "most"), [(0.95, 0.88, 0.99), (0.5, 0.38, 0.62)])
def test_the_interval_covers_the_true_value_about_as_often_as_it_says(level, least, most):
    generator = rng(0)
    covered = 0
    for seed in range(200):
        interval = rate(drawn_clips(25, generator), seed, resamples=300, level=level)
        covered += interval.low <= 0.6 <= interval.high
    assert least <= covered / 200 <= most


@pytest.mark.parametrize(
    ("hits", "voxels", "expected"),
    [
        ([30] * 8, [40] * 8, 0.75),  # identical clips
        ([3, 0, 0, 0], [4, 0, 0, 0], 0.75),  # resamples without a score are left out
        ([0, 0, 0], [0, 0, 0], math.nan),  # in none there is one
    ],
)
def test_where_no_score_can_move_the_interval_has_no_width(hits, voxels, expected):
    assert rate(clips_of(hits, voxels)) == pytest.approx((expected,) * 3, abs=0, nan_ok=True)


# --------------------------------------------------------------------------- paired differences


@pytest.mark.parametrize("hits", [5, 0])
def test_a_constant_shift_in_every_clip_is_certain(hits):
    """By no hit a run differs from itself by nothing."""
    voxels, first = torch.full((20,), 100), torch.randint(30, 90, (20,), generator=rng(0))
    runs = (clips_of(each, voxels) for each in (first, first + hits))
    difference = rate_difference(*runs, resamplings(20, 500, rng(0)))
    assert difference == pytest.approx((hits / 100, hits / 100, hits / 100, 1.0))


def test_same_sign_is_the_share_of_resamples_with_the_sign_of_the_difference():
    first, second = drawn_clips(8, rng(0)), drawn_clips(8, rng(1))
    weights = resamplings(8, 200, rng(2))
    value, *_, share = rate_difference(first, second, weights)
    agree = 0
    for row in weights:
        apart = rate_of_drawn(second, drawn(row)) - rate_of_drawn(first, drawn(row))
        agree += apart * value > 0
    assert share == pytest.approx(agree / 200)
    assert 0 < share < 1


def test_resamples_without_a_difference_are_left_out():
    first, second = clips_of([3, 0, 0], [4, 0, 0]), clips_of([1, 0, 0], [4, 0, 0])
    expected = (-0.5, -0.5, -0.5, 1.0)
    assert rate_difference(first, second, resamplings(3, 500, rng(0))) == expected


# ------------------------------------------------------------------------------ seeds and clips


def test_every_way_to_draw_three_seeds_comes_equally_often_in_random_order():
    weights = seed_resamplings(3, 1000, rng(0))
    rows, times = weights.unique(dim=0, return_counts=True)
    due = dict(zip(map(tuple, rows.tolist()), times.tolist()))
    assert len(due) == 10
    for thrice in ((3, 0, 0), (0, 3, 0), (0, 0, 3)):
        assert due[thrice] in (37, 38)  # one of 27 ways
    assert 6 * 37 <= due[1, 1, 1] <= 6 * 37 + 1  # six of 27
    assert not torch.equal(weights, weights.sort(dim=0).values)
    assert not torch.equal(weights[:27].sum(0), weights[27:54].sum(0)), "no turns"
    assert torch.equal(weights, seed_resamplings(3, 1000, rng(0)))
    assert not torch.equal(weights, seed_resamplings(3, 1000, rng(1)))


def test_seeds_that_differ_widen_the_interval_and_equal_ones_do_not():
    """On equal clips nothing but the seeds can move a score."""
    apart = [clips_of([hits] * 8, [100] * 8) for hits in (40, 50, 60)]
    assert interval_of(mean_of_seeds(*apart)[0]) == pytest.approx((0.5, 0.4, 0.6))
    assert interval_of(mean_of_seeds(*apart[:1] * 3)[0]) == pytest.approx((0.4, 0.4, 0.4))


def test_a_seed_without_a_score_is_left_out_of_the_mean():
    runs = [clips_of([0, 0], [0, 0]), clips_of([3, 3], [4, 4]), clips_of([1, 1], [4, 4])]
    sample, seeds = mean_of_seeds(*runs)
    assert sample[0] == 0.5
    only_the_first = seeds[:, 1:].sum(1) == 0
    assert only_the_first.any()
    assert torch.equal(sample[1:].isnan(), only_the_first)
