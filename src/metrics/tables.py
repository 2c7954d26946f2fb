"""Metrics whose whole state is a few integer tables."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torchmetrics import Metric

Tables = dict[str, Int64[Tensor, "..."]]
Scores = dict[str, Float[Tensor, "..."]]


class TableMetric(Metric, ABC):
    """A metric that adds up int64 tables over the frames of a data set.

    So its scores are those of the data set, not means of frames, and the same to the last bit
    whatever the batches, their order and the ranks. What a batch adds (`frame_tables`) and what the
    scores of some tables are (`scores`) are functions of their own: `ByClip` keeps the tables of
    every clip apart with them.
    """

    is_differentiable = False
    higher_is_better = True
    full_state_update = False

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], **kwargs: Any) -> None:
        """``shapes`` are those of the tables, by name."""
        super().__init__(**kwargs)
        self.shapes = dict(shapes)
        for name, shape in self.shapes.items():
            table = torch.zeros(shape, dtype=torch.int64)
            self.add_state(name, default=table, dist_reduce_fx="sum")

    @abstractmethod
    def frame_tables(self, *batch: Any, **options: Any) -> Tables:
        """The tables of every frame of a batch, stacked: [b, ...].

        Raises `UserError` for a batch that makes no sense, and then nothing has changed.
        """

    @abstractmethod
    def scores(self, tables: Tables) -> Scores:
        """The scores of tables [*n, ...], each [*n]: of many sums at once, if need be."""

    @property
    def tables(self) -> Tables:
        """What was counted so far."""
        return {name: getattr(self, name) for name in self.shapes}

    def update(self, *batch: Any, **options: Any) -> None:
        """Count a batch; the arguments are those of `frame_tables`."""
        try:
            tables = self.frame_tables(*batch, **options)
        except Exception:
            # The framework has counted this call already.
            self._update_count -= 1
            raise
        for name, table in tables.items():
            setattr(self, name, getattr(self, name) + table.sum(0))

    def forward(self, *batch: Any, **options: Any) -> Any:
        """`update`, and the score of this batch alone."""
        # The framework clears the state before it updates: a batch that raises then would lose it.
        self.frame_tables(*batch, **options)
        return super().forward(*batch, **options)

    def compute(self) -> Any:
        """The scores of everything counted so far."""
        return {name: score.float() for name, score in self.scores(self.tables).items()}
