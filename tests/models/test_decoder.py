"""Eq. 9: which voxels a pillar becomes."""

import torch

from src.geometry import VoxelGrid
from src.models.decoder import PillarDecoder

# Longer than wide, so that rows cannot be taken for columns.
GRID = VoxelGrid((0.0, -6.0, -2.0), (8.0, 6.0, 4.0), (4, 6, 3))


def test_a_pillar_becomes_the_column_of_voxels_at_its_place():
    """Without blocks no pillar knows of another one."""
    decoder = PillarDecoder(GRID, dim=8, num_blocks=0).eval()
    before = torch.zeros(1, 24, 8)
    after = before.clone()
    after[0, 1 * 6 + 4] = 1.0

    changed = (decoder(after) != decoder(before)).any(dim=1)[0]
    assert changed[1, 4].all()
    assert changed.sum() == GRID.shape[2]


def test_a_block_passes_on_what_the_pillars_beside_it_hold():
    decoder = PillarDecoder(GRID, dim=8, num_blocks=1).eval()
    pillars = torch.zeros(1, 24, 8)
    pillars[0, 0] = 1.0
    changed = (decoder(pillars) != decoder(0 * pillars)).any(dim=1)[0].any(dim=-1)
    # Two 3x3 convolutions reach two pillars far.
    assert changed[:3, :3].all()
    assert changed.sum() == 9
