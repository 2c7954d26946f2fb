"""Pillars from what the pixels see: each reference knows how likely the surface is there."""

from torch import nn

from .backbone import STRIDES
from .evidence import TOLD, Evidence
from .heights import height_projections, projected_sum
from .references import References
from .tensors import Features, Pillars, Queries


class SurfaceLift(nn.Module):
    """``B_p = 1/|J_p| sum_{j in J_p} W_j e_pj``, with the evidence of `VoxelEvidence`.

    So a pillar is told at each height what is there, where `DeformableCrossAttention` is told what
    is seen along the ray. The query is not read. A pillar with no valid reference gets exactly
    zero.

    ``dim`` is the width of the pillars, ``num_heights`` the references a pillar, ``context`` that
    of the evidence.
    """

    reads_query, reads_evidence, reads_strides = False, True, (STRIDES[0],)

    def __init__(self, dim: int, num_heights: int, context: int) -> None:
        super().__init__()
        self.output = height_projections(num_heights, dim, told=context + TOLD)

    def forward(
        self, query: Queries, features: Features, references: References, evidence: Evidence
    ) -> Pillars:
        """Returns the update of every pillar, from the evidence alone."""
        update = projected_sum(evidence.flatten(0, 2), self.output, len(evidence))
        return update / references.valid.sum(dim=-1, keepdim=True).clamp(min=1)
