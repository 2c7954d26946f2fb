"""ByClip: any set of clips scores as the plain metric on the frames of these clips."""

import pytest

from src.errors import UserError
from src.metrics import (
    ByClip,
    Calibration,
    KARBreakdown,
    KARMeanIoU,
    OccupancyScores,
    SafetyScores,
)
from tests.metrics.inputs import assert_same, updated

CLIPS = ["town/a", "town/b", "village/c", "village/empty"]
OF_FRAME = ["village/c", "town/a", "town/b", "town/a", "village/c", "town/b", "town/a"]
METRICS = (KARMeanIoU, OccupancyScores, KARBreakdown, SafetyScores, Calibration)


@pytest.fixture
def frames_for(batch_for):
    """``frames_for(make, seed)`` -> a batch of a metric, of a frame for each name in `OF_FRAME`."""
    return lambda make=KARMeanIoU, seed=0: batch_for(make, seed, frames=len(OF_FRAME))


def by_clip(grid, batch, make=KARMeanIoU, size=3):
    parts = zip(*(tensor.split(size) for tensor in batch))
    named = [(OF_FRAME[n * size : (n + 1) * size], *part) for n, part in enumerate(parts)]
    return updated(ByClip(make(grid), CLIPS), *named)


def plain(grid, batch, make=KARMeanIoU, chosen=lambda clip: True):
    rows = [n for n, clip in enumerate(OF_FRAME) if chosen(clip)]
    return updated(make(grid), tuple(tensor[rows] for tensor in batch))


def scores(metric):
    return {name: score.float() for name, score in metric.scores(metric.tables).items()}


@pytest.mark.parametrize("make", METRICS)
@pytest.mark.parametrize(
    ("prefix", "size"),
    [("", 7), ("town/", 1), ("town/b", 2), ("village/", 3), ("village/empty", 3), ("nowhere", 3)],
)
def test_chosen_clips_score_as_the_plain_metric_on_their_frames(
    grid, frames_for, make, prefix, size
):
    """Whatever the batches that the frames came in."""

    def chosen(clip):
        return clip.startswith(prefix)

    batch = frames_for(make)
    metric, alone = by_clip(grid, batch, make, size), plain(grid, batch, make, chosen)
    assert_same(metric.scores(chosen), scores(alone))
    tables = {name: table.sum(0) for name, table in metric.tables(chosen).items()}
    assert_same(tables, alone.tables)


def test_the_tables_keep_the_order_of_the_clips(grid, frames_for):
    metric = by_clip(grid, frames_for())
    chosen = metric.tables(lambda clip: clip != "town/b")["count"]
    assert chosen.equal(metric.tables()["count"][[0, 2, 3]])
    assert chosen.shape == (3, 9, 9)
    assert not chosen[2].any()


def test_it_merges_and_gives_the_score_of_a_batch_as_any_metric(grid, frames_for):
    batch, other = frames_for(), frames_for(seed=1)
    in_one = updated(by_clip(grid, batch), (OF_FRAME, *other))
    merged, forwarded = by_clip(grid, batch), by_clip(grid, batch)
    merged.merge_state(by_clip(grid, other))
    assert_same(merged.tables(), in_one.tables())
    assert_same(forwarded(OF_FRAME, *other), scores(plain(grid, other)))
    assert_same(forwarded.tables(), in_one.tables())


def test_options_reach_the_metric(grid, frames_for):
    batch = frames_for(KARBreakdown)
    visible = batch[1] == 2
    metric, alone = ByClip(KARBreakdown(grid), CLIPS), KARBreakdown(grid)
    metric.update(OF_FRAME, *batch, visible=visible)
    alone.update(*batch, visible=visible)
    # Without a choice all clips score.
    assert_same(metric.compute(), alone.compute())
    assert_same(metric.scores(), alone.compute())
    assert float(metric.compute()["visible/kar_miou"]) >= 0


def test_reset_forgets_everything_and_the_metric_inside_never_counts(grid, frames_for):
    metric = by_clip(grid, frames_for())
    assert not metric.metric.count.any()
    metric.reset()
    assert not metric.count.any()
    metric.update(OF_FRAME, *frames_for())
    assert_same(metric.tables(), by_clip(grid, frames_for()).tables())


BAD_BATCHES = {
    "unknown clip": ("clip: elsewhere", lambda c, p, t, v: ([*c[:-1], "elsewhere"], p, t, v)),
    "names of one frame": ("clip:", lambda c, p, t, v: (c[:1], p, t, v)),
    "names of all but one": ("clip:", lambda c, p, t, v: (c[:-1], p, t, v)),
    "bad target": ("target:", lambda c, p, t, v: (c, p, t.fill_(9), v)),
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, frames_for, call, what):
    names, spoil = BAD_BATCHES[what]
    metric = by_clip(grid, frames_for(), size=7)
    before = metric.tables()
    with pytest.raises(UserError, match=f"^{names}"):
        getattr(metric, call)(*spoil(OF_FRAME, *frames_for(seed=1)))
    assert_same(metric.tables(), before)
    assert metric.update_count == 1
