"""The order of an epoch, its share for every process, and streams of consecutive frames."""

import pytest
import torch

from src.data.batches import (
    ALONE,
    BatchesInOrder,
    Rank,
    StreamBatches,
    TrainingBatches,
    frames_in_order,
    runs_of,
)
from src.errors import UserError

SAMPLES = [(clip, frame) for clip in ("a", "b", "c") for frame in range(25)]


def shuffled(seed, epochs, mirror=True, length=50, batch_size=8, rank=ALONE):
    batches = TrainingBatches(length, batch_size, seed, mirror, rank)
    return [epoch_of(batches, epoch) for epoch in epochs]


def streams(epoch=0, batch_size=4, stride=1, run_frames=10, rank=ALONE, seed=0, samples=SAMPLES):
    batches = StreamBatches(samples, stride, run_frames, batch_size, seed, True, rank)
    return epoch_of(batches, epoch)


def epoch_of(batches, epoch):
    batches.set_epoch(epoch)
    drawn = list(batches)
    assert len(drawn) == len(batches)
    return drawn


def indices(batches):
    return [key.index for batch in batches for key in batch]


# ---------------------------------------------------------------------------------------- shuffled


def test_an_epoch_visits_every_sample_once_but_for_the_last_short_batch_unless_it_is_all():
    (batches,) = shuffled(0, [0])
    assert [len(batch) for batch in batches] == [8] * 6
    assert len(set(indices(batches))) == 48
    assert all(key.past is None for batch in batches for key in batch)
    (batches,) = shuffled(0, [0], length=5)
    assert sorted(indices(batches)) == list(range(5))


def test_an_order_depends_on_seed_and_epoch_alone_and_zero_is_a_seed_like_any_other():
    undisturbed = shuffled(0, range(4))
    torch.manual_seed(1)
    torch.rand(7)
    assert shuffled(0, [2, 3]) == undisturbed[2:]
    others = [*shuffled(1, range(4)), *(streams(epoch, seed=s) for epoch in (0, 1) for s in (0, 1))]
    assert len({str(order) for order in undisturbed + others}) == 12


def test_half_of_the_samples_are_mirrored_and_none_without_mirror():
    (batches,) = shuffled(0, [0], length=2000)
    assert 850 < sum(key.mirror for batch in batches for key in batch) < 1150
    (batches,) = shuffled(0, [0], mirror=False)
    assert not any(key.mirror for batch in batches for key in batch)


def test_processes_take_together_the_batches_of_one():
    """Two processes: one step of both is two steps of one, so gradients can be compared."""
    (alone,) = shuffled(0, [1], batch_size=4)
    ranks = [shuffled(0, [1], batch_size=4, rank=Rank(n, 3))[0] for n in range(3)]
    together = [batch for step in zip(*ranks) for batch in step]
    assert together == alone[: len(together)]
    assert len(together) == 12


def test_more_processes_than_frames_are_refused():
    with pytest.raises(UserError, match=r"trainer\.devices: 2\b.* 15\b"):
        TrainingBatches(15, 8, 0, True, Rank(0, 2))
    with pytest.raises(UserError, match=r"trainer\.devices: 3\b.* 2\b"):
        BatchesInOrder(2, 8, Rank(0, 3))


# ---------------------------------------------------------------------------------------- in order


@pytest.mark.parametrize("processes", [1, 2, 3])
@pytest.mark.parametrize("length", [3, 9, 64])
def test_in_order_no_frame_is_lost_or_repeated(length, processes):
    ranks = [list(BatchesInOrder(length, 4, Rank(n, processes))) for n in range(processes)]
    assert len({len(batches) for batches in ranks}) == 1, "else one waits for the others forever"
    assert all(0 < len(batch) <= 4 for batches in ranks for batch in batches)
    together = [key.index for step in zip(*ranks) for batch in step for key in batch]
    assert together == list(range(length))
    for steps in range(len(ranks[0]) + 2):
        first = [key.index for batches in ranks for batch in batches[:steps] for key in batch]
        assert sorted(first) == list(range(frames_in_order(steps, length, 4, processes)))


# ----------------------------------------------------------------------------------------- streams


def test_runs_are_consecutive_frames_of_one_clip():
    runs = runs_of(SAMPLES, stride=2, run_frames=5)
    assert sorted(index for run in runs for index in run) == list(range(75))
    for run in runs:
        clips, frames = zip(*(SAMPLES[index] for index in run))
        assert len(set(clips)) == 1
        assert list(frames) == list(range(frames[0], frames[0] + 2 * len(run), 2))
        assert len(run) <= 5
    # A gap in the samples ends a run.
    assert runs_of([("a", 0), ("a", 1), ("a", 3), ("b", 4)], 1, 10) == [[0, 1], [2], [3]]


@pytest.mark.parametrize("stride", [1, 2])
def test_what_a_key_calls_its_past_stood_in_the_same_place_before(stride):
    """The one thing that the memory of a training relies on."""
    batches = streams(stride=stride)
    seen = 0
    for step, batch in enumerate(batches):
        for place, key in enumerate(batch):
            clip, frame = SAMPLES[key.index]
            for age in range(1, key.past + 1):
                earlier = batches[step - age][place]
                assert SAMPLES[earlier.index] == (clip, frame - age * stride)
                assert earlier.mirror == key.mirror
                seen += 1
    assert seen > 150


def test_streams_visit_every_frame_once_but_for_what_fills_no_batch_and_ranks_share_none():
    assert [len(batch) for batch in streams()] == [4] * 18
    assert len(set(indices(streams()))) == 72
    ranks = [indices(streams(rank=Rank(n, 2))) for n in range(2)]
    assert len(ranks[0]) == len(ranks[1]) == 36
    assert len(set(ranks[0] + ranks[1])) == 72


def test_fewer_samples_than_places_stand_alone():
    (batch,) = streams(samples=SAMPLES[:3])
    assert sorted(key.index for key in batch) == [0, 1, 2]
    assert [key.past for key in batch] == [0, 0, 0]
