"""Deformable cross-attention from pillars to the image, at their projected heights (Eq. 8)."""

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor, nn

from ..errors import UserError
from .backbone import STRIDES
from .references import References
from .sampling import SumOfRows, bilinear_corners, bordered_rows


class DeformableCrossAttention(nn.Module):
    """``B_p = 1/|J_p| sum_{j in J_p} DA(q_p, u_pj, F)``, the paper's Eq. 8.

    ``DA`` samples ``num_points`` places per head and level around the projected reference and sums
    them with a softmax over levels and points, both predicted from the query. Each height has an
    embedding, added to the query, and an output projection W_j: a plain mean over the heights would
    lose which of them a feature came from. A pillar with no valid reference gets exactly zero.

    ``dim`` is the width of queries and features, ``num_heights`` the references a pillar.
    """

    def __init__(self, dim: int, num_heights: int, num_heads: int = 8, num_points: int = 2) -> None:
        super().__init__()
        if dim % num_heads:
            raise UserError(f"num_heads: {num_heads} does not divide dim {dim}")
        self.num_heads, self.num_points = num_heads, num_points
        self.height_embedding = nn.Parameter(0.02 * torch.randn(num_heights, dim))
        self.value = nn.Linear(dim, dim)
        self.sampling = nn.Linear(dim, num_heads * len(STRIDES) * num_points * 3)
        self.output = nn.Parameter(torch.empty(num_heights, dim, dim))
        self.register_buffer(
            "strides", torch.tensor(STRIDES, dtype=torch.float32), persistent=False
        )
        self._initialise()

    def _initialise(self) -> None:
        """Uniform attention; the first point at the reference, the others around it by head."""
        angle = torch.arange(self.num_heads) * (2 * math.pi / self.num_heads)
        radius_pix = torch.arange(self.num_points)[:, None]
        shape = (3, self.num_heads, self.num_points, len(STRIDES))
        offset_x, offset_y, _ = self.sampling.bias.data.zero_().view(shape)
        offset_x += angle.cos()[:, None, None] * radius_pix
        offset_y += angle.sin()[:, None, None] * radius_pix
        nn.init.zeros_(self.sampling.weight)
        nn.init.xavier_uniform_(self.value.weight)
        nn.init.zeros_(self.value.bias)
        for weight in self.output.data:
            nn.init.xavier_uniform_(weight)

    def forward(
        self,
        query: Float[Tensor, "#b p dim"],
        features: Sequence[Float[Tensor, "b dim _ _"]],
        references: References,
    ) -> Float[Tensor, "b p dim"]:
        """Update of every pillar, from feature maps at the strides of the backbone."""
        sizes = [tuple(feature.shape[-2:]) for feature in features]
        rows = bordered_rows([self.value(feature.permute(0, 2, 3, 1)) for feature in features])
        batch_size, table_size, dim = rows.shape
        # A table for each head and frame.
        rows = rows.view(-1, self.num_heads, dim // self.num_heads).transpose(0, 1).flatten(0, 1)
        frame, pillar, height = references.valid.nonzero().to(torch.int32).unbind(-1)
        head = torch.arange(self.num_heads, dtype=torch.int32, device=frame.device)
        base = (head[:, None, None, None] * batch_size + frame) * table_size
        x, y, attention = self._samples(query, references, (frame, pillar, height))
        index, corner_weight = bilinear_corners(x, y, sizes, base)
        sampled = SumOfRows.apply(
            rows,
            self._by_bag(index),
            self._by_bag((attention * corner_weight).to(rows.dtype)),
            self._offsets(references.valid),
        )
        total = sampled.view(*references.valid.shape[:2], -1) @ self.output.flatten(0, 1)
        return total / references.valid.sum(dim=-1, keepdim=True).clamp(min=1)

    def _samples(
        self,
        query: Float[Tensor, "#b p dim"],
        references: References,
        valid: tuple[Int[Tensor, "r"], Int[Tensor, "r"], Int[Tensor, "r"]],
    ) -> tuple[Float[Tensor, "heads points levels r"], ...]:
        """x and y, in pixels of each level, and weight of what the R valid references sample."""
        frame, pillar, height = valid
        row = pillar if len(query) == 1 else frame * query.shape[1] + pillar
        by_query = F.embedding(row, self.sampling(query).flatten(0, 1))
        by_height = F.embedding(height, F.linear(self.height_embedding, self.sampling.weight))
        raw = (by_query + by_height).float().T.contiguous()
        raw = raw.view(3, self.num_heads, self.num_points, len(STRIDES), -1)
        u, v = references.pix[valid].T[:, None]
        x, y = (pix / self.strides[:, None] - 0.5 for pix in (u, v))
        attention = raw[2].flatten(1, 2).softmax(dim=1).view_as(raw[2])
        return x + raw[0], y + raw[1], attention

    @staticmethod
    def _by_bag(entries: Shaped[Tensor, "4 heads points levels r"]) -> Shaped[Tensor, "i"]:
        """Flat, with what is summed for one reference and head side by side."""
        return entries.permute(4, 1, 0, 2, 3).flatten()

    def _offsets(self, valid: Bool[Tensor, "b p j"]) -> Int[Tensor, "k+1"]:
        """Where the entries of each (pillar, height, head) start; an invalid height has none."""
        entries = 4 * self.num_points * len(STRIDES)
        count = (valid.flatten().to(torch.int32) * entries).repeat_interleave(self.num_heads)
        return F.pad(count.cumsum(0, dtype=torch.int32), (1, 0))
