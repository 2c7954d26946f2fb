"""Intervals by resampling clips and seeds: exact cases, their coverage, and paired differences."""

import math

import pytest
import torch

from src.errors import UserError
from src.metrics import KARMeanIoU
from src.metrics.count_metric import CountMetric
from src.results.bootstrap import (
    interval_of,
    resamplings,
    same_sign,
    score_samples,
    seed_resamplings,
    seed_sample,
)
from tests.results.scored import GRID, predicted, truth


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


def score_intervals(metric, tables, weights, level=0.95):
    samples = score_samples(metric, tables, weights)
    return {name: interval_of(sample, level) for name, sample in samples.items()}


def rate_difference(first, second, weights):
    """The difference of two rates, its bounds, and the share of the resamples of its sign."""
    one, other = (score_samples(HitRate(), tables, weights)["rate"] for tables in (first, second))
    return *interval_of(other - one), same_sign(other - one)


def rate(tables, seed=0, resamples=500, **arguments):
    weights = resamplings(len(tables["hits"]), resamples, rng(seed))
    return score_intervals(HitRate(), tables, weights, **arguments)["rate"]


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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("level", [0.5, 0.9])
def test_the_value_is_of_all_clips_and_the_bounds_are_quantiles_of_the_drawn_ones(level, seed):
    tables = drawn_clips(6, rng(seed))
    weights = resamplings(6, 101, rng(2))
    rates = sorted(rate_of_drawn(tables, drawn(row)) for row in weights)
    cut = round(100 * (1 - level) / 2)
    expected = rate_of_drawn(tables, range(6)), rates[cut], rates[100 - cut]
    interval = score_intervals(HitRate(), tables, weights, level)["rate"]
    assert interval == pytest.approx(expected)
    assert interval.low < interval.value < interval.high


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


def shifted(tables, hits):
    return clips_of(tables["hits"][:, 0] + hits, tables["voxels"][:, 0])


def equal_clips(clips, generator):
    voxels = torch.full((clips,), 100)
    return clips_of(torch.randint(30, 90, (clips,), generator=generator), voxels)


@pytest.mark.parametrize("hits", [5, 0])
def test_a_constant_shift_in_every_clip_is_certain(hits):
    """By no hit a run differs from itself by nothing."""
    first = equal_clips(20, rng(0))
    difference = rate_difference(first, shifted(first, hits), resamplings(20, 500, rng(0)))
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


# ------------------------------------------------------------------------------- real metrics


def test_the_resamples_of_a_metric_score_as_its_repeated_frames():
    target = truth(5, seed=0)
    batch = (predicted(target, 0.5, 0), target, 6 * torch.randn(5, 3, generator=rng(0)))
    metric = KARMeanIoU(GRID)
    weights = resamplings(5, 1, rng(0))
    interval = score_intervals(metric, metric.frame_counts(*batch), weights)["kar_miou"]
    metric.update(*(tensor[drawn(weights[0])] for tensor in batch))
    assert interval.low == interval.high == pytest.approx(float(metric.compute()), abs=1e-7)
    assert interval.value != interval.low


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


def rates_of(samples):
    return torch.stack([sample["rate"] for sample in samples])


def two_levels(runs, seed=0, resamples=101):
    """Samples of every run on the same draws of clips, and draws of the runs."""
    clips = resamplings(len(runs[0]["hits"]), resamples, rng(seed))
    seeds = seed_resamplings(len(runs), resamples, rng(seed + 1))
    samples = [score_samples(HitRate(), tables, clips) for tables in runs]
    return clips, seeds, rates_of(samples)


def test_a_resample_of_two_levels_is_the_mean_over_drawn_seeds_on_the_drawn_clips():
    """Written out: seeds one by one, their clips one by one, then sorted bounds."""
    runs = [drawn_clips(7, rng(seed)) for seed in range(3)]
    clips, seeds, samples = two_levels(runs)
    means = []
    for clip_times, seed_times in zip(clips, seeds):
        assert (len(drawn(clip_times)), len(drawn(seed_times))) == (7, 3)
        rates = [rate_of_drawn(runs[n], drawn(clip_times)) for n in drawn(seed_times)]
        means.append(sum(rates) / 3)
    sample = seed_sample(samples, seeds)
    torch.testing.assert_close(sample[1:], torch.tensor(means, dtype=torch.float64))
    whole = [float(run["hits"].sum() / run["voxels"].sum()) for run in runs]
    means.sort()
    assert interval_of(sample, 0.9) == pytest.approx((sum(whole) / 3, means[5], means[95]))


def test_a_single_seed_adds_nothing_to_the_clips():
    tables = drawn_clips(9, rng(0))
    clips, seeds, samples = two_levels([tables])
    assert (
        interval_of(seed_sample(samples, seeds), 0.9)
        == (score_intervals(HitRate(), tables, clips, 0.9)["rate"])
    )


def test_seeds_that_differ_widen_the_interval_and_equal_ones_do_not():
    """On equal clips nothing but the seeds can move a score."""
    apart = [clips_of([hits] * 8, [100] * 8) for hits in (40, 50, 60)]
    _, seeds, samples = two_levels(apart, resamples=2000)
    assert interval_of(seed_sample(samples, seeds)) == pytest.approx((0.5, 0.4, 0.6))
    _, seeds, samples = two_levels(apart[:1] * 3)
    assert interval_of(seed_sample(samples, seeds)) == pytest.approx((0.4, 0.4, 0.4))


def test_a_seed_without_a_score_is_left_out_of_the_mean():
    runs = [clips_of([0, 0], [0, 0]), clips_of([3, 3], [4, 4]), clips_of([1, 1], [4, 4])]
    _, seeds, samples = two_levels(runs)
    sample = seed_sample(samples, seeds)
    assert sample[0] == 0.5
    only_the_first = seeds[:, 1:].sum(1) == 0
    assert only_the_first.any()
    assert torch.equal(sample[1:].isnan(), only_the_first)
