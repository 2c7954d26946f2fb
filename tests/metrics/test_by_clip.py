"""ByClip: any set of clips scores as the plain metric on the frames of these clips."""

import pytest

from src.errors import UserError
from src.metrics import ByClip, Calibration, KARBreakdown, KARMeanIoU, SafetyScores
from tests.metrics.inputs import assert_same, updated

CLIPS = ["town/a", "town/b", "village/c", "village/empty"]
OF_FRAME = ["village/c", "town/a", "town/b", "town/a", "village/c", "town/b", "town/a"]


def by_clip(grid, batch, make=KARMeanIoU, size=3):
    parts = zip(*(tensor.split(size) for tensor in batch))
    named = [(OF_FRAME[n * size : (n + 1) * size], *part) for n, part in enumerate(parts)]
    return updated(ByClip(make(grid), CLIPS), *named)


@pytest.mark.parametrize("make", [KARMeanIoU, KARBreakdown, SafetyScores, Calibration])
@pytest.mark.parametrize(
    ("prefix", "size"), [("", 7), ("town/", 1), ("village/", 3), ("village/empty", 3)]
)
def test_chosen_clips_score_as_the_plain_metric_on_their_frames(
    grid, batch_for, make, prefix, size
):
    """Whatever the batches that the frames came in."""
    batch = batch_for(make, frames=7)
    rows = [n for n, clip in enumerate(OF_FRAME) if clip.startswith(prefix)]
    alone = updated(make(grid), tuple(tensor[rows] for tensor in batch))
    metric = by_clip(grid, batch, make, size)
    counts = metric.of_clips(lambda clip: clip.startswith(prefix))
    assert_same(metric.scores(counts), alone.scores(alone.counts))
    assert_same({name: each.sum(0) for name, each in counts.items()}, dict(alone.counts))


def test_clips_keep_their_order_and_states_merge_as_those_of_any_metric(grid, batch_for):
    batch, other = (batch_for(KARMeanIoU, seed, frames=7) for seed in range(2))
    in_one = updated(by_clip(grid, batch), (OF_FRAME, *other))
    chosen = in_one.of_clips(lambda clip: clip != "town/b")["count"]
    assert chosen.equal(in_one.count[[0, 2, 3]])

    merged, forwarded = by_clip(grid, batch), by_clip(grid, batch)
    merged.merge_state(by_clip(grid, other))
    assert_same(forwarded(OF_FRAME, *other), by_clip(grid, other).compute())
    for each in (merged, forwarded):
        assert_same(each.counts, in_one.counts)


BAD_BATCHES = {
    "unknown clip": ("clip: elsewhere", lambda c, p, t, v: ([*c[:-1], "elsewhere"], p, t, v)),
    "names of one frame": ("clip:", lambda c, p, t, v: (c[:1], p, t, v)),
    "bad target": ("target:", lambda c, p, t, v: (c, p, t.fill_(9), v)),
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, batch_for, call, what):
    names, spoil = BAD_BATCHES[what]
    metric = by_clip(grid, batch_for(KARMeanIoU, frames=7), size=7)
    before = metric.count.clone()
    with pytest.raises(UserError, match=f"^{names}"):
        getattr(metric, call)(*spoil(OF_FRAME, *batch_for(KARMeanIoU, 1, frames=7)))
    assert_same(metric.count, before)
    assert metric.update_count == 1
