"""Semantic voxel decoder (the paper's Psi_occ): pillars to a dense volume of logits."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..geometry import VoxelGrid
from ..ontology import NUM_CLASSES
from .tensors import Logits, Pillars


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions on the pillar map, added to their input."""

    recomputable = True

    def __init__(self, dim: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(dim, dim, 3, padding=1, bias=False),
            nn.BatchNorm2d(dim),
            nn.ReLU(inplace=True),
            nn.Conv2d(dim, dim, 3, padding=1, bias=False),
            nn.BatchNorm2d(dim),
        )

    def forward(self, x: Float[Tensor, "b dim x y"]) -> Float[Tensor, "b dim x y"]:
        return torch.relu(x + self.body(x))


class PillarDecoder(nn.Module):
    """Residual 2-D blocks on the pillar map, then channels to height: no 3-D convolution.

    ``class_prior`` (nine probabilities or counts, in the order of the ontology) sets the last bias
    to their logarithm, so that training starts at the prior; without it the bias is zero.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        dim: int = 256,
        num_blocks: int = 2,
        class_prior: Sequence[float] | None = None,
    ) -> None:
        super().__init__()
        self.grid = grid
        self.blocks = nn.Sequential(*(ResidualBlock(dim) for _ in range(num_blocks)))
        self.head = nn.Sequential(
            nn.Linear(dim, 2 * dim), nn.ReLU(), nn.Linear(2 * dim, NUM_CLASSES * grid.shape[2])
        )

        nn.init.zeros_(self.head[-1].bias)
        if class_prior is not None:
            # Most voxels are free: from equal logits, training would have to learn that first.
            prior = torch.tensor(class_prior, dtype=torch.float32)
            log_prior = (prior / prior.sum()).clamp(min=1e-6).log()
            self.head[-1].bias.data.copy_(log_prior.repeat_interleave(grid.shape[2]))

    def forward(self, pillars: Pillars) -> Logits:
        """Returns logits [B, 9, X, Y, Z], always float32."""
        rows, columns, heights = self.grid.shape
        channels_last = pillars.unflatten(1, (rows, columns))
        x = self.blocks(channels_last.permute(0, 3, 1, 2))
        logits = self.head(x.permute(0, 2, 3, 1)).float()
        return logits.unflatten(-1, (NUM_CLASSES, heights)).permute(0, 3, 1, 2, 4)
