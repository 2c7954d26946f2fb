"""What the pixels see as evidence for the voxels, after the lifting."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from ..geometry import VoxelGrid
from ..ontology import FREE, NUM_CLASSES
from .references import PillarReferences, Projection, References
from .sight import Sight, place_of
from .tensors import Logits, Pillars

# The surface is taken to lie in a voxel where its depth is so many voxels from the center's.
REACH_VOXELS = 0.75
# Numbers of a voxel: surface here, surface behind, eight classes here, and whether it is in view.
WIDTH = 2 + FREE + 1

VoxelEvidence = Float[Tensor, "b p k width"]


class Evidence(nn.Module):
    """Reads a `Sight` twice: for an addition to the pillars, and for one to the logits of each
    voxel of ``grid``, which begins at zero.

    ``projection`` is that of the network's references. ``hidden`` is the width between a voxel's
    evidence and its logits.
    """

    def __init__(
        self, grid: VoxelGrid, dim: int, bins: int, projection: Projection, hidden: int = 32
    ) -> None:
        super().__init__()
        self.voxel_m, self.bins = grid.voxel_m, bins
        self.voxels = PillarReferences(grid, grid.shape[2], projection)
        self.of_pillars = nn.Linear(grid.shape[2] * WIDTH, dim)
        self.of_voxels = nn.Sequential(
            nn.Linear(WIDTH, hidden), nn.ReLU(), nn.Linear(hidden, NUM_CLASSES)
        )
        nn.init.zeros_(self.of_voxels[-1].weight)
        nn.init.zeros_(self.of_voxels[-1].bias)

    def of(self, sight: Sight, references: References, stride: int) -> VoxelEvidence:
        """Returns the evidence for every voxel, with its ``references`` of ``self.voxels``."""
        depth = sight.depth.float().softmax(dim=1)
        # How likely the surface is nearer than the edge of each bin, the first edge included.
        nearer = F.pad(depth[:, :-1].cumsum(dim=1), (0, 0, 0, 0, 1, 0))
        # A place behind the camera may be anywhere; what is read there does not count.
        pix = (references.pix / stride).nan_to_num(0.0)
        reach_m = REACH_VOXELS * self.voxel_m
        before, until = (
            sample_trilinear(nearer, pix, place_of(references.depth_m + side_m, self.bins))
            for side_m in (-reach_m, reach_m)
        )
        classes = sight.classes[:, :FREE].float().softmax(dim=1)
        classes = sample_bilinear(classes, pix)

        here = (until - before)[..., None]
        behind = (1 - until)[..., None]

        valid = references.valid[..., None]
        evidence = torch.cat([here, behind, here * classes, torch.ones_like(here)], dim=-1)
        return evidence * valid

    def pillars(self, evidence: VoxelEvidence) -> Pillars:
        """Returns what is added to the pillars before they are decoded."""
        return self.of_pillars(evidence.flatten(2))

    def logits(self, evidence: VoxelEvidence, shape: tuple[int, int]) -> Logits:
        """Returns what is added to the logits of the volume, of so many rows and columns."""
        by_voxel = self.of_voxels(evidence).float()
        return by_voxel.unflatten(1, shape).permute(0, 4, 1, 2, 3)


def sample_bilinear(
    maps: Float[Tensor, "b c h w"], pix: Float[Tensor, "b p k 2"]
) -> Float[Tensor, "b p k c"]:
    """Reads maps at places in their own pixels, whose first one covers [0, 1) x [0, 1)."""
    height, width = maps.shape[-2:]
    share = (2 * pix / pix.new_tensor((width, height)) - 1).clamp(-2, 2)
    read = F.grid_sample(maps, share, padding_mode="border", align_corners=False)
    return read.permute(0, 2, 3, 1)


def sample_trilinear(
    maps: Float[Tensor, "b c h w"], pix: Float[Tensor, "b p k 2"], channel: Float[Tensor, "b p k"]
) -> Float[Tensor, "b p k"]:
    """Reads maps as `sample_bilinear` does, each place at one number between two channels.

    To read all channels first, or `grid_sample` in 3-D, takes eight and two times as long.
    """
    channels, height, width = maps.shape[1:]
    column, right = _between(pix[..., 0] - 0.5, width)
    row, down = _between(pix[..., 1] - 0.5, height)
    first, deeper = _between(channel, channels)
    frame = torch.arange(len(maps), device=maps.device)[:, None, None]
    corner = ((frame * height + row) * width + column) * channels + first

    flat = maps.permute(0, 2, 3, 1).flatten()
    total = torch.zeros_like(channel)
    for rows, of_row in enumerate((1 - down, down)):
        for columns, of_column in enumerate((1 - right, right)):
            at = corner + (rows * width + columns) * channels
            lower, upper = flat[at], flat[at + 1]
            total = total + of_row * of_column * (lower + deeper * (upper - lower))
    return total


def _between(place: Float[Tensor, "*n"], size: int) -> tuple[Int[Tensor, "*n"], Tensor]:
    """Returns the first of the two neighbours of a place among ``size``, and the rest."""
    place = place.clamp(0, size - 1)
    first = place.floor().clamp(max=size - 2)
    return first.long(), place - first
