"""Spatiotemporal pillar encoder (Sec. 4.2 of the paper)."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid
from .backbone import STRIDES
from .history import History, TemporalAttention, align_history
from .references import PillarReferences, Projection, References
from .tensors import Features, Pillars, Queries


class EncoderLayer(nn.Module):
    """Lifting and a feed-forward network, each on a normalised residual."""

    recomputable = True

    def __init__(self, dim: int, lift: nn.Module) -> None:
        super().__init__()
        self.lift = lift
        self.feed_forward = nn.Sequential(
            nn.Linear(dim, 2 * dim), nn.ReLU(), nn.Linear(2 * dim, dim)
        )
        # A norm that nothing reads would have no gradient, and training on several devices refuse.
        before_lift = nn.LayerNorm(dim) if getattr(lift, "reads_query", True) else nn.Identity()
        self.norms = nn.ModuleList([before_lift, nn.LayerNorm(dim)])

    def forward(self, pillars: Queries, features: Features, references: References) -> Pillars:
        before_lift, before_feed_forward = self.norms
        pillars = pillars + self.lift(before_lift(pillars), features, references)
        return pillars + self.feed_forward(before_feed_forward(pillars))


class PillarEncoder(nn.Module):
    """Pillars of one frame from its image features, its geometry and, if given, its history.

    The first ``num_layers - 1`` layers see one frame alone (`frame`); what they give is cached as
    the history of later frames. In the last one (`fuse`) the queries first aggregate the aligned
    history (Eq. 7), then gather evidence from the current image (Eq. 8). So a frame of a stream
    passes through every layer once.

    ``grid`` places the pillars: one for each (x, y) cell, P = X * Y of them in row-major order,
    ``dim`` wide. ``num_heights`` references a pillar, ``None`` for one a voxel; ``num_frames`` is
    the paper's L; ``projection`` and ``capacity`` are `PillarReferences`'s. ``lift`` builds the
    lifting of each layer from ``dim`` and ``num_heights``: `DeformableCrossAttention` is the
    paper's, and any module with its call can take its place. It may say that it does without
    something: ``reads_query = False``, or ``reads_strides``, those of the feature levels that it
    does read.

    Raises `UserError` for a history (``num_frames`` above 1) without a layer that sees a past
    frame.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        lift: Callable[..., nn.Module],
        dim: int = 256,
        num_layers: int = 3,
        num_heights: int | None = 8,
        num_frames: int = 4,
        num_heads: int = 8,
        projection: Projection = "attitude",
        capacity: float | None = None,
    ) -> None:
        super().__init__()
        if num_layers < (2 if num_frames > 1 else 1):
            raise UserError(
                f"model.encoder.num_layers: {num_layers} leaves no layer to see a past frame; give "
                "2 or more, or data.frames=1"
            )

        self.grid, self.dim, self.num_frames = grid, dim, num_frames
        rows, columns, bins = grid.shape
        num_heights = num_heights or bins

        self.query = nn.Parameter(0.02 * torch.randn(rows, columns, dim))
        self.row = nn.Parameter(torch.randn(rows, 1, dim))
        self.column = nn.Parameter(torch.randn(1, columns, dim))

        self.references = PillarReferences(grid, num_heights, projection, capacity)
        *first_layers, self.last_layer = (
            EncoderLayer(dim, lift(dim=dim, num_heights=num_heights)) for _ in range(num_layers)
        )
        self.frame_layers = nn.ModuleList(first_layers)
        lifts = [layer.lift for layer in (*first_layers, self.last_layer)]
        self.reads_strides = {s for lift in lifts for s in getattr(lift, "reads_strides", STRIDES)}

        self.frame_norm = nn.LayerNorm(dim)
        self.temporal = TemporalAttention(dim, num_heads, num_frames)
        self.norm = nn.LayerNorm(dim)

    def frame(
        self,
        features: Features,
        references: References,
        told: Float[Tensor, "b 1 dim"] | None = None,
    ) -> Pillars:
        """Pillars of a frame from its image alone; ``references`` are from ``self.references``, and
        ``told`` is added to every query."""
        pillars = (self.query + self.row + self.column).flatten(0, 1)[None]
        if told is not None:
            pillars = pillars + told
        for layer in self.frame_layers:
            pillars = layer(pillars, features, references)
        return self.frame_norm(pillars).expand(len(references.valid), -1, -1)

    def fuse(
        self,
        pillars: Pillars,
        features: Features,
        references: References,
        history: History | None = None,
    ) -> Pillars:
        """What `frame` gave, with its history, if there is one, and once more its image."""
        aligned = None if history is None else align_history(history, self.grid)
        pillars = pillars + self.temporal(pillars, aligned)
        return self.norm(self.last_layer(pillars, features, references))

    def no_history(self, pillars: Pillars) -> History | None:
        """A history of one frame that does not exist; ``None`` for an encoder without history.

        It changes no number. In training it brings every parameter into the graph, which several
        processes that share their gradients rely on.
        """
        if self.temporal.dz is None:
            return None
        motion = pillars.new_zeros(len(pillars), 1, 4, 4)
        valid = torch.zeros(len(pillars), 1, dtype=torch.bool, device=pillars.device)
        return History(torch.zeros_like(pillars[:, None]), motion, valid)
