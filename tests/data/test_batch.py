"""The mirror: an exact symmetry of image, geometry and labels."""

import pytest
import torch

from src.data.batch import mirrored
from src.data.dataset import OccupancyDataset
from src.geometry import (
    camera_from_occ,
    euler_from_rotation,
    project,
    rotation_from_euler,
    transform,
)
from tests.data.conftest import assert_same

# The mirror of the occ frame: left and right change places.
ACROSS = torch.tensor([1.0, -1.0, 1.0])


@pytest.fixture
def sample(clips):
    """Off the axis: a mount to the left, a camera that looks aside, a skewed and shifted image."""
    sample = OccupancyDataset(clips, [("downtown/clip00", 20)], 4, 0.2)[0]
    aside = rotation_from_euler(*torch.tensor([0.05, 0.2, 0.1]))
    mount = sample["body_from_camera"].clone()
    mount[:3, :3] = aside @ mount[:3, :3]
    mount[1, 3] = 0.3
    pix_from_camera = sample["pix_from_camera"].clone()
    pix_from_camera[:, 0, 1], pix_from_camera[:, 0, 2] = 1.5, 41.0
    return {**sample, "body_from_camera": mount, "pix_from_camera": pix_from_camera}


def pixels(sample, points_occ, step):
    chain = camera_from_occ(sample["occ_from_body"][step], sample["body_from_camera"])
    return project(points_occ, chain, sample["pix_from_camera"][step])


def random_points(count=200):
    generator = torch.Generator().manual_seed(0)
    low, high = torch.tensor([2.0, -20.0, -15.0]), torch.tensor([50.0, 20.0, 8.0])
    return low + (high - low) * torch.rand(count, 3, generator=generator)


@pytest.mark.parametrize("step", range(4))
def test_mirrored_points_fall_on_mirrored_pixels_and_their_past_is_aligned_as_before(sample, step):
    points_occ, mirror = random_points(), mirrored(sample)
    pix, depth_m = pixels(sample, points_occ, step)
    mirror_pix, mirror_depth_m = pixels(mirror, points_occ * ACROSS, step)
    expected = torch.stack([sample["image"].shape[-1] - pix[:, 0], pix[:, 1]], dim=-1)
    torch.testing.assert_close(mirror_pix, expected, atol=2e-3, rtol=1e-4)
    torch.testing.assert_close(mirror_depth_m, depth_m, atol=1e-4, rtol=0)

    now = transform(sample["occ_from_past_occ"][step], points_occ)
    mirror_now = transform(mirror["occ_from_past_occ"][step], points_occ * ACROSS)
    torch.testing.assert_close(mirror_now, now * ACROSS, atol=1e-4, rtol=1e-5)


def test_a_mirror_of_the_mirror_is_the_sample_and_swaps_left_and_right(sample):
    mirror = mirrored(sample)
    for name, axis in {"semantics": 1, "visible": 1, "image": -1}.items():
        assert torch.equal(mirror[name], sample[name].flip(axis))
    assert torch.equal(mirror["velocity_mps"], sample["velocity_mps"] * ACROSS)
    assert torch.equal(mirror["height_m"], sample["height_m"])
    roll, pitch, _ = euler_from_rotation(mirror["occ_from_body"][-1, :3, :3])
    torch.testing.assert_close(torch.stack([roll, pitch]), mirror["attitude_rad"])

    for name in ("body_from_camera", "occ_from_body", "occ_from_past_occ"):
        rotation = mirror[name][..., :3, :3]
        assert torch.allclose(torch.linalg.det(rotation), torch.ones(rotation.shape[:-2]))
    assert_same(mirrored(mirror), sample)
