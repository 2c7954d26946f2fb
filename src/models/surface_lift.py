"""Pillars from what the pixels see: each reference knows how likely the surface is there."""

import torch
import torch.nn.functional as F
from torch import nn

from ..geometry import VoxelGrid
from ..ontology import NUM_CLASSES
from .backbone import STRIDES
from .heights import height_projections, projected_mean
from .references import References
from .sight import Sight, places_along_rays
from .tensors import Features, Pillars, Queries

# On each side of a voxel's center, in voxels: rays cross it at an angle.
REACH = 0.6


class SurfaceLift(nn.Module):
    """``B_p = 1/|J_p| sum_{j in J_p} W_j [s_pj F(u_pj), s_pj, f_pj, h_pj]``.

    At the pixel ``u_pj`` of a reference (Eq. 5), ``s_pj`` is the probability that the surface is
    there, ``f_pj`` that it lies behind, so that the reference is free, and ``h_pj`` that it hides
    the reference: those of the pixel's `Sight`. ``F`` is ``context`` numbers made of the finest
    feature, and the pixel's class. So a pillar is told at each height what is there, where
    `DeformableCrossAttention` is told what is seen along the ray. The query is not read.

    ``dim`` is the width of features and pillars, ``num_heights`` the references a pillar in
    ``grid``.
    """

    reads_query, reads_sight, reads_strides = False, True, (STRIDES[0],)

    def __init__(self, dim: int, num_heights: int, grid: VoxelGrid, context: int = 16) -> None:
        super().__init__()
        self.reach_m = REACH * grid.voxel_m
        self.context = nn.Linear(dim, context)
        self.output = height_projections(num_heights, dim, told=context + NUM_CLASSES + 3)

    def forward(
        self, query: Queries, features: Features, references: References, sight: Sight
    ) -> Pillars:
        """Returns the update of every pillar, from the finest feature map and its `Sight`."""
        feature = features[0].permute(0, 2, 3, 1)
        height, width = feature.shape[1:3]
        listed = references.listed()
        place = references.in_view.clamp(max=references.valid.numel() - 1)

        column, row = (listed.pix / STRIDES[0]).long().unbind(-1)
        column, row = column.clamp(max=width - 1), row.clamp(max=height - 1)
        pixel = (listed.frame * height + row) * width + column
        depth_m = references.depth_m.flatten()[place]
        surface, free, hidden = places_along_rays(sight, pixel, depth_m, self.reach_m)

        classes = sight.classes.softmax(dim=1).permute(0, 2, 3, 1)
        seen = torch.cat([self.context(feature), classes.to(feature)], dim=-1).flatten(0, 2)
        there = F.embedding(pixel, seen) * surface[:, None].to(seen)
        told = torch.cat([there, torch.stack([surface, free, hidden], dim=-1).to(seen)], dim=-1)
        return projected_mean(told, self.output, references)
