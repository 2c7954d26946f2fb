"""What the pixels say of the references of the pillars: a surface is there, they are free, hidden.

So a voxel is told what is in it, where a lifting of features tells it what is seen along its ray.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from ..geometry import VoxelGrid
from ..ontology import NUM_CLASSES
from .backbone import STRIDES
from .references import References
from .sight import Sight

# What every reference is told of its pixel, beside the context: the classes and three places.
TOLD = NUM_CLASSES + 3
# On each side of a voxel's center, in voxels: rays cross it at an angle.
REACH = 0.6

# Of the J references of P pillars.
Evidence = Float[Tensor, "b p j told"]


class VoxelEvidence(nn.Module):
    """``e_pj = [s_pj C F(u_pj), s_pj c(u_pj), s_pj, f_pj, h_pj]`` of every reference.

    At the pixel ``u_pj`` of a reference (Eq. 5), ``s_pj`` is the probability that the surface is
    there, ``f_pj`` that it lies behind, so that the reference is free, and ``h_pj`` that it hides
    the reference. They and the probabilities ``c`` of the classes are those of the pixel's `Sight`;
    ``C F`` is ``context`` numbers made of the finest feature, which is ``dim`` wide. A reference
    that is not in view has zeros.

    ``grid`` is that of the pillars, whose voxels say how far a surface may be from a reference.
    """

    def __init__(self, dim: int, grid: VoxelGrid, context: int) -> None:
        super().__init__()
        self.reach_m = REACH * grid.voxel_m
        self.context = nn.Linear(dim, context)

    def forward(
        self, sight: Sight, feature: Float[Tensor, "b dim h w"], references: References
    ) -> Evidence:
        """Returns the evidence of all references, from the finest feature map and its `Sight`."""
        feature = feature.permute(0, 2, 3, 1)
        height, width = feature.shape[1:3]
        listed = references.listed()

        column, row = (listed.pix / STRIDES[0]).long().unbind(-1)
        column, row = column.clamp(max=width - 1), row.clamp(max=height - 1)
        pixel = (listed.frame * height + row) * width + column
        total = references.valid.numel()
        depth_m = references.depth_m.flatten()[references.in_view.clamp(max=total - 1)]
        places = places_along_rays(sight, pixel, depth_m, self.reach_m)

        classes = sight.classes.softmax(dim=1).permute(0, 2, 3, 1)
        seen = torch.cat([self.context(feature), classes.to(feature)], dim=-1).flatten(0, 2)
        there = F.embedding(pixel, seen) * places[:, :1].to(seen)
        told = torch.cat([there, places.to(seen)], dim=-1)

        # Padding goes to one row more, which is dropped.
        evidence = told.new_zeros(total + 1, told.shape[-1])
        evidence = evidence.index_copy(0, references.in_view, told)[:total]
        return evidence.view(*references.valid.shape, -1)


def places_along_rays(
    sight: Sight, pixel: Int[Tensor, "r"], depth_m: Float[Tensor, "r"], reach_m: float
) -> Float[Tensor, "r 3"]:
    """Returns the probabilities that a point is on the surface, up to a reach; in front of it; and
    behind it. ``pixel`` numbers the pixels of the batch."""
    behind = sight.nearer(pixel, depth_m - reach_m)
    not_in_front = sight.nearer(pixel, depth_m + reach_m)
    return torch.stack([not_in_front - behind, 1 - not_in_front, behind], dim=-1)
