"""The counts of a metric, kept apart by clip."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from ..errors import UserError
from .count_metric import CountMetric, NamedCounts, Scores


class ByClip(CountMetric):
    """A metric over a dataset whose clips can be told apart afterwards.

    Frames of one clip are alike, so intervals resample clips (`bootstrap`), and the parts of a
    split are sets of clips. `update` takes the clip of every frame first, and then what the metric
    takes. `compute` gives the scores of all clips together.

    Args:
        metric: says what a frame adds; its own state stays empty.
        clips: the ids of all clips that may come.

    Raises `UserError` for a clip that is none of them, and as the metric does; then nothing has
    changed.
    """

    def __init__(self, metric: CountMetric, clips: Sequence[str], **kwargs: Any) -> None:
        shapes = {name: (len(clips), *each.shape) for name, each in metric.counts.items()}
        super().__init__(shapes, **kwargs)
        self.metric = metric
        self.clips = list(clips)
        self.row = {clip: n for n, clip in enumerate(self.clips)}

    def frame_counts(self, clip: Sequence[str], *batch: Any, **options: Any) -> NamedCounts:
        """Returns the metric's counts of every frame, whose clips are known."""
        if unknown := [name for name in clip if name not in self.row]:
            raise UserError(f"clip: {unknown[0]} is none of the {len(self.clips)} clips to score")

        counts = self.metric.frame_counts(*batch, **options)
        frames = len(next(iter(counts.values())))
        if len(clip) != frames:
            raise UserError(f"clip: names {len(clip)} frames, and the batch has {frames}")
        return counts

    def added(self, total: Tensor, of_frames: Tensor, clip: Sequence[str], *_: Any) -> Tensor:
        """Adds what every frame counts to the row of its clip."""
        rows = torch.tensor([self.row[name] for name in clip], dtype=torch.int64)
        return total.index_add(0, rows.to(of_frames.device), of_frames)

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts [clips, ...] of all these clips together."""
        return self.metric.scores({name: each.sum(0) for name, each in counts.items()})

    def of_clips(self, chosen: Callable[[str], bool] = lambda clip: True) -> NamedCounts:
        """Returns the counts of every chosen clip, [clips, ...], on all ranks."""
        rows = [n for clip, n in self.row.items() if chosen(clip)]
        with self.sync_context():
            return {name: each[rows] for name, each in self.counts.items()}
