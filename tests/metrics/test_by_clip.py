"""ByClip: any set of clips scores as the plain metric on the frames of these clips."""

import pytest
import torch

from src.errors import UserError
from src.metrics import (
    ByClip,
    Calibration,
    KARBreakdown,
    KARMeanIoU,
    KARSensitivity,
    OccupancyScores,
    SafetyScores,
)

CLIPS = ["town/a", "town/b", "village/c", "village/empty"]
OF_FRAME = ["village/c", "town/a", "town/b", "town/a", "village/c", "town/b", "town/a"]
METRICS = pytest.mark.parametrize(
    "make", [KARMeanIoU, OccupancyScores, KARBreakdown, SafetyScores, KARSensitivity, Calibration]
)


@pytest.fixture
def batch_for(random_batch):
    """``batch_for(make)`` -> a batch of a metric, of a frame for each name in `OF_FRAME`."""

    def give(make, seed=0):
        preds, target, velocity = random_batch(seed, frames=len(OF_FRAME))
        if make is Calibration:
            rng = torch.Generator().manual_seed(seed)
            preds = torch.randn(len(target), 9, *target.shape[1:], generator=rng)
        return preds, target, velocity

    return give


def by_clip(make, grid, batch, size=3):
    metric = ByClip(make(grid), CLIPS)
    parts = zip(*(tensor.split(size) for tensor in batch))
    for n, part in enumerate(parts):
        metric.update(OF_FRAME[n * size : (n + 1) * size], *part)
    return metric


def plain(make, grid, batch, chosen=lambda clip: True):
    metric = make(grid)
    rows = [n for n, clip in enumerate(OF_FRAME) if chosen(clip)]
    if rows:
        metric.update(*(tensor[rows] for tensor in batch))
    return {name: score.float() for name, score in metric.scores(metric.tables).items()}


def same(a, b):
    return list(a) == list(b) and all(
        torch.equal(a[name].nan_to_num(-1), b[name].nan_to_num(-1)) for name in a
    )


def state(metric):
    return {name: getattr(metric, name).clone() for name in metric.metric.shapes}


def equal(a, b):
    return all(torch.equal(a[name], b[name]) for name in a)


@METRICS
def test_all_clips_score_as_the_plain_metric(grid, batch_for, make):
    batch = batch_for(make)
    metric = by_clip(make, grid, batch)
    expected = plain(make, grid, batch)
    assert same(metric.scores(), expected)
    assert same(metric.compute(), expected)


@METRICS
@pytest.mark.parametrize("prefix", ["town/", "town/b", "village/", "village/empty", "nowhere"])
def test_chosen_clips_score_as_the_plain_metric_on_their_frames(grid, batch_for, make, prefix):
    batch = batch_for(make)
    metric = by_clip(make, grid, batch)
    found = metric.scores(lambda clip: clip.startswith(prefix))
    expected = plain(make, grid, batch, lambda clip: clip.startswith(prefix))
    assert same(found, expected)
    assert not same(found, plain(make, grid, batch))


@METRICS
def test_the_tables_of_a_clip_are_those_of_its_frames(grid, batch_for, make):
    batch = batch_for(make)
    metric = by_clip(make, grid, batch)
    for clip in CLIPS[:3]:
        alone = make(grid)
        alone.update(*(tensor[[name == clip for name in OF_FRAME]] for tensor in batch))
        found = metric.tables(lambda name, clip=clip: name == clip)
        assert equal({name: table[0] for name, table in found.items()}, alone.tables)


def test_the_tables_keep_the_order_of_the_clips(grid, batch_for):
    metric = by_clip(KARMeanIoU, grid, batch_for(KARMeanIoU))
    chosen = metric.tables(lambda clip: clip != "town/b")["count"]
    assert torch.equal(chosen, metric.tables()["count"][[0, 2, 3]])
    assert chosen.shape == (3, 9, 9)
    assert not chosen[2].any()


@pytest.mark.parametrize("size", [1, 2, 7])
def test_any_split_into_batches_gives_the_same_bits(grid, batch_for, size):
    batch = batch_for(SafetyScores)
    expected = state(by_clip(SafetyScores, grid, batch))
    assert equal(state(by_clip(SafetyScores, grid, batch, size)), expected)


def test_merged_states_equal_one_pass(grid, batch_for):
    batch, other = batch_for(KARMeanIoU), batch_for(KARMeanIoU, seed=1)
    merged, in_one = by_clip(KARMeanIoU, grid, batch), by_clip(KARMeanIoU, grid, batch)
    merged.merge_state(by_clip(KARMeanIoU, grid, other))
    in_one.update(OF_FRAME, *other)
    assert equal(state(merged), state(in_one))


def test_options_reach_the_metric(grid, batch_for):
    batch = batch_for(KARBreakdown)
    visible = batch[1] == 2
    metric = ByClip(KARBreakdown(grid), CLIPS)
    metric.update(OF_FRAME, *batch, visible=visible)
    alone = KARBreakdown(grid)
    alone.update(*batch, visible=visible)
    assert same(metric.compute(), alone.compute())
    assert float(metric.compute()["visible/kar_miou"]) >= 0


def test_the_metric_inside_counts_nothing_itself(grid, batch_for):
    metric = by_clip(KARMeanIoU, grid, batch_for(KARMeanIoU))
    assert not metric.metric.count.any()


def test_reset_forgets_everything(grid, batch_for):
    batch = batch_for(KARMeanIoU)
    metric = by_clip(KARMeanIoU, grid, batch)
    metric.reset()
    assert not metric.count.any()
    metric.update(OF_FRAME, *batch)
    assert equal(state(metric), state(by_clip(KARMeanIoU, grid, batch)))


def test_forward_gives_the_score_of_the_batch_and_accumulates(grid, batch_for):
    batch, other = batch_for(KARMeanIoU), batch_for(KARMeanIoU, seed=1)
    metric = by_clip(KARMeanIoU, grid, batch)
    assert same(metric(OF_FRAME, *other), plain(KARMeanIoU, grid, other))
    both = by_clip(KARMeanIoU, grid, batch)
    both.update(OF_FRAME, *other)
    assert equal(state(metric), state(both))


def unknown_clip(clip, preds, target, velocity):
    return [*clip[:-1], "elsewhere"], preds, target, velocity


def bad_target(clip, preds, target, velocity):
    return clip, preds, target.fill_(9), velocity


@pytest.mark.parametrize(
    ("names", "spoil"), [("clip: elsewhere", unknown_clip), ("target:", bad_target)]
)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, batch_for, names, spoil):
    metric = by_clip(KARMeanIoU, grid, batch_for(KARMeanIoU))
    before, score = state(metric), metric.compute()
    with pytest.raises(UserError, match=f"^{names}"):
        metric.update(*spoil(OF_FRAME, *batch_for(KARMeanIoU, seed=1)))
    assert equal(state(metric), before)
    assert same(metric.compute(), score)


@pytest.mark.parametrize(
    ("names", "spoil"), [("clip: elsewhere", unknown_clip), ("target:", bad_target)]
)
def test_a_bad_batch_leaves_the_state_in_forward_too(grid, batch_for, names, spoil):
    metric = by_clip(KARMeanIoU, grid, batch_for(KARMeanIoU))
    before = state(metric)
    with pytest.raises(UserError, match=f"^{names}"):
        metric(*spoil(OF_FRAME, *batch_for(KARMeanIoU, seed=1)))
    assert equal(state(metric), before)


@pytest.mark.parametrize("spoil", [unknown_clip, bad_target])
def test_a_bad_batch_is_not_counted_as_an_update(grid, batch_for, spoil):
    metric = by_clip(KARMeanIoU, grid, batch_for(KARMeanIoU), size=7)
    with pytest.raises(UserError):
        metric.update(*spoil(OF_FRAME, *batch_for(KARMeanIoU, seed=1)))
    assert metric.update_count == 1


@pytest.mark.parametrize("frames", [1, 6])
def test_fewer_clips_than_frames_are_refused_by_name_and_leave_the_state(grid, batch_for, frames):
    metric = by_clip(SafetyScores, grid, batch_for(SafetyScores))
    before = state(metric)
    with pytest.raises(UserError, match=r"^clip:"):
        metric.update(OF_FRAME[:frames], *batch_for(SafetyScores, seed=1))
    assert equal(state(metric), before)
