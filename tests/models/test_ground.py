"""Logits above the ground, brought to the voxels of a UAV at some height."""

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.models.ground import GroundVolume, above_ground
from tests.models.synthetic import VOLUME, build_batch, build_network

GRID = VoxelGrid((0, -1, -4), (2, 1, 2), (2, 2, 6))
ABOVE = VoxelGrid((0, -1, -1), (2, 1, 7), (2, 2, 8))
LOGITS = torch.randn(3, 9, 2, 2, 8, generator=torch.Generator().manual_seed(0))


def test_a_volume_on_the_ground_has_the_same_pillars_and_voxels():
    assert above_ground(GRID, -1, 7) == ABOVE
    with pytest.raises(UserError, match="does not divide"):
        above_ground(GRID, -1.25, 7)


def test_a_height_of_whole_voxels_moves_whole_voxels():
    """At 3 m the grid reaches from 1 m below the ground to 5 m above it."""
    seen = GroundVolume(ABOVE, GRID)(LOGITS, torch.tensor([3.0, 4.0, 5.0]))
    for frame, logits in enumerate(seen):
        torch.testing.assert_close(logits, LOGITS[frame, ..., frame : frame + 6])


def test_between_two_voxels_lies_their_mean_and_beyond_the_ends_the_last():
    ground = GroundVolume(ABOVE, GRID)
    halfway = ground(LOGITS[:1], torch.tensor([3.5]))
    torch.testing.assert_close(halfway[0], (LOGITS[0, ..., 0:6] + LOGITS[0, ..., 1:7]) / 2)
    high, low = (ground(LOGITS[:1], torch.tensor([h]))[0] for h in (40.0, -40.0))
    torch.testing.assert_close(high, LOGITS[0, ..., -1:].expand(-1, -1, -1, 6))
    torch.testing.assert_close(low, LOGITS[0, ..., :1].expand(-1, -1, -1, 6))

    expected = ground(LOGITS, torch.tensor([3.3, 4.1, 5.2]))
    with torch.autocast("cpu", torch.bfloat16):
        assert ground(LOGITS, torch.tensor([3.3, 4.1, 5.2])).equal(expected)


def test_a_frame_of_the_past_is_seen_from_its_own_height():
    """A UAV that has sunk by 2 m since then was 2 m higher."""
    network, batch = build_network(volume=VOLUME), build_batch(frames=2)
    batch["occ_from_past_occ"][:, 0, 2, 3] = 2.0
    past = network.encode(batch, 0).references
    higher = {**batch, "height_m": batch["height_m"] + 2.0}
    higher["occ_from_body"] = batch["occ_from_body"].flip(1)
    torch.testing.assert_close(past.pix, network.encode(higher, -1).references.pix)


@pytest.mark.parametrize("other", [VoxelGrid((0, -2, -1), (2, 2, 7), (2, 4, 8)), VOLUME])
def test_other_pillars_are_refused(other):
    with pytest.raises(UserError, match=r"^model\.decoder\.grid\.\w+: .* z alone$"):
        GroundVolume(other, GRID)
