"""Eq. 9: which voxels a pillar becomes."""

import pytest
import torch

from src.geometry import VoxelGrid
from src.models.decoder import PillarDecoder

# Longer than wide, so that rows cannot be taken for columns.
GRID = VoxelGrid((0.0, -6.0, -2.0), (8.0, 6.0, 4.0), (4, 6, 3))


@pytest.mark.parametrize("blocks", [0, 1])
def test_a_pillar_becomes_the_column_of_voxels_at_its_place(blocks):
    """Without blocks no pillar knows of another one; with two 3x3 convolutions, of those around."""
    decoder = PillarDecoder(GRID, dim=8, num_blocks=blocks).eval()
    pillars = torch.zeros(1, 24, 8)
    pillars[0, 1 * 6 + 5] = 1.0
    changed = (decoder(pillars) != decoder(0 * pillars)).any(dim=1)[0]
    expected = torch.zeros(GRID.shape, dtype=torch.bool)
    expected[0 if blocks else 1 : 4 if blocks else 2, 3 if blocks else 5 :] = True
    assert changed.equal(expected)


def test_the_last_bias_is_the_log_prior():
    prior = [5, 20, 5, 1, 1, 1, 0, 2, 65]
    decoder = PillarDecoder(GRID, dim=8, num_blocks=1, class_prior=prior)
    decoder.head[-1].weight.data.zero_()
    probability = decoder(torch.randn(1, 24, 8)).softmax(1)[0, :, 3, 4, 2]
    torch.testing.assert_close(probability, torch.tensor(prior) / 100, atol=1e-5, rtol=1e-4)
