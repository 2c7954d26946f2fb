"""From features at the heights of a pillar to its update: an output projection W_j a height."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from .references import References
from .tensors import Pillars

# What is gathered at each height of the pillars, and the projections W_j of the heights.
Gathered = Float[Tensor, "r dim"]
Projections = Float[Tensor, "j dim dim"]


def height_projections(num_heights: int, dim: int, gain: float = 1.0) -> nn.Parameter:
    """Returns a projection a height, each as a linear layer would start, times a gain."""
    projections = nn.Parameter(torch.empty(num_heights, dim, dim))
    for weight in projections.data:
        nn.init.xavier_uniform_(weight, gain)
    return projections


def gain_of_mean(num_heights: int) -> float:
    """Returns the gain with which `projected_mean` starts as large as the pillars it is added to.

    A mean over heights is smaller than each of them by the root of their number, and what they
    gather is itself a mean over levels, of about half their size. Where the image begins as a tenth
    of the sum, training first learns what can be known without one.
    """
    return 2 * num_heights**0.5


def projected_sum(by_height: Gathered, projections: Projections, batch_size: int) -> Pillars:
    """Returns ``sum_j f_pj W_j``: a plain sum would lose which height a feature came from."""
    by_pillar = by_height.view(batch_size, -1, projections.shape[:2].numel())
    return by_pillar @ projections.flatten(0, 1)


def projected_mean(sampled: Gathered, projections: Projections, references: References) -> Pillars:
    """Returns ``1/|J_p| sum_{j in J_p} f_pj W_j`` of the samples at ``references.in_view``.

    A pillar with no valid reference gets exactly zero.
    """
    total = references.valid.numel()
    # Padding goes to one row more, which is dropped.
    by_height = sampled.new_zeros(total + 1, sampled.shape[-1])
    by_height = by_height.index_copy_(0, references.in_view, sampled)[:total]

    update = projected_sum(by_height, projections, len(references.valid))
    return update / references.valid.sum(dim=-1, keepdim=True).clamp(min=1)
