"""The batches of an epoch: which frames stand together, in which order, on which device.

Each of these is a batch sampler whose batches are lists of `Key`. They know the rank of their
process and how many there are, so that no frame is repeated, nor lost where it is scored;
Lightning's own distributed sampler would repeat some to make all ranks equal, and count them twice.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from torch.utils.data import Sampler

from ..errors import UserError

# Of the training frames: `TrainingBatches` and `StreamBatches`.
ORDERS = ("shuffled", "streams")


class Key(NamedTuple):
    """A sample of a dataset: its number, whether it is mirrored, and how many frames before it
    its history may hold (``None``: as many as it has)."""

    index: int
    mirror: bool = False
    past: int | None = None


class Rank(NamedTuple):
    """The number of this process, and how many there are."""

    number: int
    of: int


ALONE = Rank(0, 1)


class BatchesInOrder(Sampler[list[Key]]):
    """Every sample once, in order: for scoring.

    Every rank gets equally many batches, of nearly equal size: a rank that waited for the others'
    last batch would wait forever. Raises `UserError` for fewer samples than processes.
    """

    def __init__(self, length: int, batch_size: int, rank: Rank = ALONE) -> None:
        if length < rank.of:
            raise UserError(f"trainer.devices: {rank.of} processes for {length} frames; use fewer")
        # Rank k takes every batch whose number leaves the remainder k.
        parts = _parts(length, batch_size, rank.of)
        self.batches = [part.tolist() for part in parts[rank.number :: rank.of]]

    def __len__(self) -> int:
        return len(self.batches)

    def __iter__(self) -> Iterator[list[Key]]:
        return iter([Key(index) for index in batch] for batch in self.batches)


def frames_in_order(batches: int, length: int, batch_size: int, processes: int) -> int:
    """Counts the samples in the first batches of every rank's `BatchesInOrder`."""
    return sum(map(len, _parts(length, batch_size, processes)[: batches * processes]))


def _parts(length: int, batch_size: int, processes: int) -> list[np.ndarray]:
    """Returns the samples in order, in equally many parts for every process."""
    # Rounded up, so that no sample is left over.
    steps = -(-length // (batch_size * processes))
    return np.array_split(np.arange(length), steps * processes)


class TrainingBatches(Sampler[list[Key]]):
    """A new order every epoch, and a coin for the mirror, from the seed and the epoch alone.

    So a resumed run sees what the undisturbed one would have seen, and N processes take together
    the batches that one would take in N steps. What does not fill a batch on every rank is left
    out of this epoch, unless it is all there is.
    """

    def __init__(
        self, length: int, batch_size: int, seed: int, mirror: bool, rank: Rank = ALONE
    ) -> None:
        if length < batch_size * rank.of and rank.of > 1:
            raise UserError(
                f"trainer.devices: {rank.of} processes of data.batch_size {batch_size} need more "
                f"than the {length} training frames; lower one of them"
            )
        self.length, self.batch_size, self.seed, self.mirror = length, batch_size, seed, mirror
        self.rank, self.epoch = rank, 0

    @property
    def sampler(self) -> "TrainingBatches":
        """This sampler itself, on which Lightning calls `set_epoch`."""
        return self

    def set_epoch(self, epoch: int) -> None:
        """Takes the number of the epoch, which the trainer says at its start."""
        self.epoch = epoch

    def __len__(self) -> int:
        return max(1, self.length // (self.batch_size * self.rank.of))

    def __iter__(self) -> Iterator[list[Key]]:
        # No state is kept between epochs: a resumed run draws what the first would have drawn.
        rng = np.random.default_rng([self.seed, self.epoch])
        order = rng.permutation(self.length)
        coins = (rng.random(self.length) < 0.5) & self.mirror
        keys = [Key(*drawn) for drawn in zip(order.tolist(), coins.tolist())]

        for step in range(len(self)):
            # Step by step, the ranks take neighboring batches of one order.
            start = (step * self.rank.of + self.rank.number) * self.batch_size
            yield keys[start : start + self.batch_size]


class StreamBatches(TrainingBatches):
    """Consecutive frames, a history step apart, in every place of the batch.

    So what a step computed of a frame is the next step's history (`models.history`), and no past
    frame is computed for it. The samples are cut into runs of ``run_frames`` frames, which are
    shuffled, and the places of the batches of all ranks each take an equal share of them; a run
    begins without history. ``stride`` is a history step in frames.
    """

    def __init__(
        self,
        samples: Sequence[tuple[str, int]],
        stride: int,
        run_frames: int,
        batch_size: int,
        seed: int,
        mirror: bool,
        rank: Rank = ALONE,
    ) -> None:
        super().__init__(len(samples), batch_size, seed, mirror, rank)
        # Of fewer samples than places, each is a batch place of its own.
        self.places = min(batch_size, self.length)
        self.runs = runs_of(samples, stride, run_frames)

    def __iter__(self) -> Iterator[list[Key]]:
        rng = np.random.default_rng([self.seed, self.epoch])
        # Whole runs are shuffled: the frames of one must stay in their order.
        order = rng.permutation(len(self.runs)).tolist()
        coins = ((rng.random(len(self.runs)) < 0.5) & self.mirror).tolist()
        keys = []
        for run in order:
            keys += [Key(index, coins[run], past) for past, index in enumerate(self.runs[run])]

        steps, first = len(self), self.rank.number * self.places
        for step in range(steps):
            batch = [keys[place * steps + step] for place in range(first, first + self.places)]
            # A run that was cut by the border between two places begins anew there.
            yield [key._replace(past=min(key.past, step)) for key in batch]


def runs_of(samples: Sequence[tuple[str, int]], stride: int, run_frames: int) -> list[list[int]]:
    """Numbers the samples, in runs of at most ``run_frames`` frames that follow each other."""
    number = {sample: index for index, sample in enumerate(samples)}
    runs: list[list[int]] = []
    for clip, frame in number:
        if (clip, frame - stride) in number:
            continue

        # The sample before this one is missing, so a run begins here.
        whole = []
        while (clip, frame) in number:
            whole.append(number[clip, frame])
            frame += stride
        runs += [whole[start : start + run_frames] for start in range(0, len(whole), run_frames)]
    return runs
