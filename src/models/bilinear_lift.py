"""Pillars from the image without a query: the mean of what their references see (Simple-BEV)."""

import torch
from torch import nn

from .heights import gain_of_mean, height_projections, projected_mean
from .references import References
from .sampling import summed_samples
from .tensors import Features, Pillars, Queries


class BilinearLift(nn.Module):
    """``B_p = 1/|J_p| sum_{j in J_p} W_j mean_l F_l(u_pj)`` (Harley et al. 2023, Sec. 3).

    ``F_l`` is bilinearly sampled, zero outside the image. The mean is over all levels of the
    pyramid, and each height has an output projection. `DeformableCrossAttention` with one point
    computes this before it has learned anything. So the two differ in one thing: whether the query
    has a say in where and how much is sampled. A pillar with no valid reference gets exactly zero.

    ``dim`` is the width of features and pillars, ``num_heights`` the references a pillar.
    """

    reads_query = False

    def __init__(self, dim: int, num_heights: int) -> None:
        super().__init__()
        self.output = height_projections(num_heights, dim, gain_of_mean(num_heights))

    def forward(self, query: Queries | None, features: Features, references: References) -> Pillars:
        """Returns the update of every pillar, from feature maps at the strides of the backbone."""
        levels = [feature.permute(0, 2, 3, 1) for feature in features]
        listed = references.listed()

        # One head and one point: the two axes that `summed_samples` has before the levels.
        x, y = listed.pix_of_levels()[:, None, None]
        weight = torch.full_like(x, 1 / len(levels))
        sampled = summed_samples(levels, x, y, weight, listed.frame)
        return projected_mean(sampled, self.output, references)
