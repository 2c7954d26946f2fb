"""Deformable cross-attention from pillars to the image, at their projected heights (Eq. 8)."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Int
from torch import Tensor, nn

from ..errors import UserError
from .backbone import STRIDES
from .heights import gain_of_mean, height_projections, projected_mean
from .references import References
from .sampling import Samples, summed_samples
from .tensors import Features, Pillars, Queries


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
            raise UserError(f"size.heads: {num_heads} does not divide size.dim, {dim}")

        self.num_heads, self.num_points = num_heads, num_points
        self.height_embedding = nn.Parameter(0.02 * torch.randn(num_heights, dim))
        self.value = nn.Linear(dim, dim)
        # Three numbers a sample: its offset in x and y, and the logit of its weight.
        self.sampling = nn.Linear(dim, num_heads * len(STRIDES) * num_points * 3)
        self._initialise()
        self.output = height_projections(num_heights, dim, gain_of_mean(num_heights))

    def _initialise(self) -> None:
        """Begins with uniform attention: the first point at the reference, the others around it.

        As in Deformable DETR, each head looks into a direction of its own.
        """
        angle = torch.arange(self.num_heads) * (2 * math.pi / self.num_heads)
        radius_pix = torch.arange(self.num_points)[:, None]

        shape = (3, self.num_heads, self.num_points, len(STRIDES))
        offset_x, offset_y, _ = self.sampling.bias.data.zero_().view(shape)
        offset_x += angle.cos()[:, None, None] * radius_pix
        offset_y += angle.sin()[:, None, None] * radius_pix

        nn.init.zeros_(self.sampling.weight)
        nn.init.xavier_uniform_(self.value.weight)
        nn.init.zeros_(self.value.bias)

    def forward(self, query: Queries, features: Features, references: References) -> Pillars:
        """Returns the update of every pillar, from feature maps at the strides of the backbone."""
        levels = [self.value(feature.permute(0, 2, 3, 1)) for feature in features]
        frame, x, y, attention = self._samples(query, references)
        sampled = summed_samples(levels, x, y, attention, frame)
        return projected_mean(sampled, self.output, references)

    def _samples(
        self, query: Queries, references: References
    ) -> tuple[Int[Tensor, "r"], Samples, Samples, Samples]:
        """Returns frame, x, y (pixels of each level) and weight of what the R references sample."""
        listed = references.listed()
        row = listed.pillar
        if len(query) > 1:
            row = row + listed.frame * query.shape[1]

        # Query and height embedding enter one linear layer. It is applied to both before they are
        # spread over the references, of which there are many times more.
        by_query = F.embedding(row, self.sampling(query).flatten(0, 1))
        by_height = F.linear(self.height_embedding, self.sampling.weight)
        by_height = F.embedding(listed.height, by_height)
        raw = (by_query + by_height).float().T.contiguous()
        raw = raw.view(3, self.num_heads, self.num_points, len(STRIDES), -1)

        x, y = listed.pix_of_levels()
        attention = raw[2].flatten(1, 2).softmax(dim=1).view_as(raw[2])
        return listed.frame, x + raw[0], y + raw[1], attention
