"""The tables of a metric, kept apart by clip."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Int64
from torch import Tensor
from torchmetrics import Metric

from ..errors import UserError
from .tables import Scores, TableMetric, Tables, uncounted_if_it_raises


class ByClip(Metric):
    """A metric over a dataset whose clips can be told apart afterwards.

    Frames of one clip are alike, so intervals resample clips (`bootstrap`), and the parts of a
    split are sets of clips. `compute` gives the scores of all clips together.

    Args:
        metric: says what a frame adds; its own state stays empty.
        clips: the ids of all clips that may come.

    Raises `UserError` for a clip that is none of them, and as the metric does; then nothing has
    changed.
    """

    is_differentiable = False
    full_state_update = False

    def __init__(self, metric: TableMetric, clips: Sequence[str], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for name, table in metric.tables.items():
            of_clips = table.new_zeros(len(clips), *table.shape)
            self.add_state(name, default=of_clips, dist_reduce_fx="sum")
        self.metric = metric
        self.clips = list(clips)
        self.row = {clip: n for n, clip in enumerate(self.clips)}

    def update(self, clip: Sequence[str], *batch: Any, **options: Any) -> None:
        """Adds the tables of a batch to those of its clips.

        ``clip`` names the clip of every frame, the rest is the metric's own.
        """
        with uncounted_if_it_raises(self):
            rows, tables = self._frames(clip, *batch, **options)
        for name, table in tables.items():
            setattr(self, name, getattr(self, name).index_add(0, rows.to(table.device), table))

    def forward(self, clip: Sequence[str], *batch: Any, **options: Any) -> Scores:
        """Adds the tables of a batch, and returns the scores of this batch alone."""
        self._frames(clip, *batch, **options)  # before the state is cleared, as in `TableMetric`
        return super().forward(clip, *batch, **options)

    def _frames(
        self, clip: Sequence[str], *batch: Any, **options: Any
    ) -> tuple[Int64[Tensor, "b"], Tables]:
        """Returns the row of each frame's clip, and the tables of every frame."""
        if unknown := [name for name in clip if name not in self.row]:
            raise UserError(f"clip: {unknown[0]} is none of the {len(self.clips)} clips to score")

        tables = self.metric.frame_tables(*batch, **options)
        frames = len(next(iter(tables.values())))
        if len(clip) != frames:
            raise UserError(f"clip: names {len(clip)} frames, and the batch has {frames}")
        return torch.tensor([self.row[name] for name in clip], dtype=torch.int64), tables

    def tables(self, chosen: Callable[[str], bool] = lambda clip: True) -> Tables:
        """Returns the tables of every chosen clip, [clips, ...]."""
        rows = [n for clip, n in self.row.items() if chosen(clip)]
        # Inside `compute` the ranks' states are summed already.
        alone = not self._is_synced
        with self.sync_context(should_sync=alone, should_unsync=alone):
            return {name: table[rows] for name, table in self.metric_state.items()}

    def compute(self) -> Scores:
        """Returns the scores of all clips together."""
        return self.scores()

    def scores(self, chosen: Callable[[str], bool] = lambda clip: True) -> Scores:
        """Returns the scores of the chosen clips together."""
        summed = {name: table.sum(0) for name, table in self.tables(chosen).items()}
        return {name: score.float() for name, score in self.metric.scores(summed).items()}
