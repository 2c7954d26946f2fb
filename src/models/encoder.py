"""Spatiotemporal pillar encoder (Sec. 4.2 of the paper)."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..geometry import VoxelGrid
from .history import AlignedHistory, History, TemporalAttention, align_history
from .references import PillarReferences, Projection, References


class EncoderLayer(nn.Module):
    """Temporal attention, lifting and a feed-forward network, each on a normalised residual."""

    def __init__(self, dim: int, num_frames: int, num_heads: int, lift: nn.Module) -> None:
        super().__init__()
        self.temporal = TemporalAttention(dim, num_heads, num_frames)
        self.lift = lift
        self.feed_forward = nn.Sequential(
            nn.Linear(dim, 2 * dim), nn.ReLU(), nn.Linear(2 * dim, dim)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(dim) for _ in range(3))

    def forward(
        self,
        pillars: Float[Tensor, "#b p dim"],
        features: Sequence[Float[Tensor, "b dim _ _"]],
        references: References,
        history: AlignedHistory | None,
    ) -> Float[Tensor, "b p dim"]:
        before_temporal, before_lift, before_feed_forward = self.norms
        pillars = pillars + self.temporal(before_temporal(pillars), history)
        pillars = pillars + self.lift(before_lift(pillars), features, references)
        return pillars + self.feed_forward(before_feed_forward(pillars))


class PillarEncoder(nn.Module):
    """Pillars of one frame from its image features, its geometry and, if given, its history.

    ``grid`` places the pillars: one for each (x, y) cell, P = X * Y of them in row-major order,
    ``dim`` wide. ``num_heights`` references a pillar; ``num_frames`` is the paper's L;
    ``projection`` is `PillarReferences`'s. ``lift`` builds the lifting of each layer from ``dim``
    and ``num_heights``: `DeformableCrossAttention` is the paper's, and any module with its call can
    take its place.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        lift: Callable[..., nn.Module],
        dim: int = 256,
        num_layers: int = 3,
        num_heights: int = 8,
        num_frames: int = 4,
        num_heads: int = 8,
        projection: Projection = "attitude",
    ) -> None:
        super().__init__()
        self.grid, self.dim = grid, dim
        rows, columns, _ = grid.shape
        self.query = nn.Parameter(0.02 * torch.randn(rows, columns, dim))
        self.row = nn.Parameter(torch.randn(rows, 1, dim))
        self.column = nn.Parameter(torch.randn(1, columns, dim))
        self.references = PillarReferences(grid, num_heights, projection)
        self.layers = nn.ModuleList(
            EncoderLayer(dim, num_frames, num_heads, lift(dim=dim, num_heights=num_heights))
            for _ in range(num_layers)
        )
        self.norm = nn.LayerNorm(dim)

    def forward(
        self,
        features: Sequence[Float[Tensor, "b dim _ _"]],
        references: References,
        history: History | None = None,
    ) -> Float[Tensor, "b p dim"]:
        """``references`` are this frame's, from ``self.references``; no history is ``None``."""
        aligned = None if history is None else align_history(history, self.grid)
        pillars = (self.query + self.row + self.column).flatten(0, 1)[None]
        for layer in self.layers:
            pillars = layer(pillars, features, references, aligned)
        return self.norm(pillars)
