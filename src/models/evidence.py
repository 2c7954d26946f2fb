"""What the pixels see as evidence for the voxels: before the lifting and after it."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from ..geometry import VoxelGrid
from ..ontology import FREE, NUM_CLASSES
from .references import PillarReferences, Projection, References
from .sight import Sight, place_of
from .tensors import Logits, Pillars

# The surface is taken to lie in a voxel where it is so many voxels from its center along the ray.
REACH_VOXELS = 0.75
# Numbers of a voxel: surface here, surface behind, eight classes here, and whether it is in view.
WIDTH = 2 + FREE + 1

VoxelEvidence = Float[Tensor, "b p k width"]


class Evidence(nn.Module):
    """Reads a `Sight` three times: as a feature of the pixels, as an addition to the pillars, and
    as one to the logits of each voxel of ``grid``, which begins at zero.

    ``projection`` is that of the network's references. ``hidden`` is the width between a voxel's
    evidence and its logits.
    """

    def __init__(
        self, grid: VoxelGrid, dim: int, bins: int, projection: Projection, hidden: int = 32
    ) -> None:
        super().__init__()
        self.voxel_m, self.bins = grid.voxel_m, bins
        self.voxels = PillarReferences(grid, grid.shape[2], projection)
        self.of_pixels = nn.Conv2d(bins + 1, dim, 1)
        self.of_pillars = nn.Linear(grid.shape[2] * WIDTH, dim)
        self.of_voxels = nn.Sequential(
            nn.Linear(WIDTH, hidden), nn.ReLU(), nn.Linear(hidden, NUM_CLASSES)
        )
        nn.init.zeros_(self.of_voxels[-1].weight)
        nn.init.zeros_(self.of_voxels[-1].bias)

    def feature(self, sight: Sight) -> Float[Tensor, "b dim h w"]:
        """Returns what the distribution of the depth adds to the finest features."""
        return self.of_pixels(sight.depth.softmax(dim=1))

    def of(self, sight: Sight, references: References, stride: int) -> VoxelEvidence:
        """Returns the evidence for every voxel, with its ``references`` of ``self.voxels``."""
        depth = sight.depth.float().softmax(dim=1)
        # How likely the surface is nearer than the edge of each bin, the first edge included.
        nearer = F.pad(depth[:, :-1].cumsum(dim=1), (0, 0, 0, 0, 1, 0))
        classes = sight.classes[:, :FREE].float().softmax(dim=1)
        maps = torch.cat([nearer, classes], dim=1)
        sampled = sample_bilinear(maps, references.pix / stride)

        edges = nearer.shape[1]
        nearer, classes = sampled.split([edges, FREE], dim=-1)
        reach_m = REACH_VOXELS * self.voxel_m
        before = _interpolated(nearer, place_of(references.depth_m - reach_m, edges - 1))
        until = _interpolated(nearer, place_of(references.depth_m + reach_m, edges - 1))
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
    maps: Float[Tensor, "b c h w"], place: Float[Tensor, "b p k 2"]
) -> Float[Tensor, "b p k c"]:
    """Reads maps at places in their own pixels, whose first one covers [0, 1) x [0, 1)."""
    height, width = maps.shape[-2:]
    share = 2 * place / place.new_tensor((width, height)) - 1
    # A place behind the camera may be anywhere; what is read there does not count.
    share = share.nan_to_num(0.0).clamp(-2, 2)
    read = F.grid_sample(maps, share, padding_mode="border", align_corners=False)
    return read.permute(0, 2, 3, 1)


def _interpolated(
    nearer: Float[Tensor, "b p k edges"], place: Float[Tensor, "b p k"]
) -> Float[Tensor, "b p k"]:
    """Returns a cumulated distribution at a place between two edges."""
    first = place.floor().clamp(max=nearer.shape[-1] - 2)
    pair = first.long()[..., None] + torch.arange(2, device=place.device)
    lower, upper = nearer.gather(-1, pair).unbind(-1)
    return lower + (place - first) * (upper - lower)
