import math

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid, front_mount
from src.models.references import PillarReferences, padded_index
from tests.models.synthetic import GRID, IMAGE_SIZE, seen_by

MOUNT = front_mount((0.0, 0.0, 0.0))


def seen(references, roll_rad, pitch_rad, mount=MOUNT, **height):
    """What the camera of one UAV in that attitude sees of the references."""
    return seen_by(references, [(roll_rad, pitch_rad)], mount, **height)


def test_points_are_at_pillar_centers_and_middles_of_equal_slices():
    points = PillarReferences(GRID, 4, "attitude").points
    assert points.shape == (100, 4, 3)
    torch.testing.assert_close(points[0, :, 2], torch.tensor([-16.25, -8.75, -1.25, 6.25]))
    torch.testing.assert_close(points[23, 0, :2], torch.tensor([12.5, -7.5]))


def test_a_point_straight_ahead_is_at_the_principal_point_and_moves_with_pitch():
    """Nose down by 0.2 rad, level ground ahead climbs in the image by f tan(0.2)."""
    references = PillarReferences(VoxelGrid((0, -1, -1), (50, 1, 1), (25, 1, 1)), 1, "attitude")
    level = seen(references, 0.0, 0.0)
    torch.testing.assert_close(level.pix[0, 5, 0], torch.tensor([48.0, 32.0]))
    torch.testing.assert_close(level.depth_m[0, 5, 0], torch.tensor(11.0))
    nose_down = seen(references, 0.0, 0.2)
    expected = torch.tensor([48.0, 32.0 - 48.0 * math.tan(0.2)])
    torch.testing.assert_close(nose_down.pix[0, 5, 0], expected)


def test_level_ignores_attitude_and_keeps_the_mount():
    attitude, level = (PillarReferences(GRID, 4, p) for p in ("attitude", "level"))
    mount = front_mount((0.3, 0.0, 0.1), pitch_rad=0.25)
    flat = seen(attitude, 0.0, 0.0, mount)
    rolled = seen(level, 0.3, -0.2, mount)
    for a, b in zip(flat, rolled):
        torch.testing.assert_close(a, b)
    assert flat.in_view.equal(flat.valid.flatten().nonzero()[:, 0])
    assert not torch.equal(seen(attitude, 0.3, -0.2, mount).pix, flat.pix)


def test_a_grid_on_the_ground_is_seen_from_above():
    """The point at 2 m above the ground lies 5 m below a UAV at 7 m, however it is tilted."""
    grids = (VoxelGrid((0, -1, z), (50, 1, z + 2), (25, 1, 1)) for z in (1, -6))
    above_ground, below_uav = (PillarReferences(grid, 1, "attitude") for grid in grids)
    on_ground = seen(above_ground, 0.3, 0.2, height_m=torch.tensor([7.0]))
    below = seen(below_uav, 0.3, 0.2)
    torch.testing.assert_close(on_ground.pix, below.pix, atol=1e-3, rtol=0)
    torch.testing.assert_close(on_ground.depth_m, below.depth_m)
    assert on_ground.in_view.equal(below.in_view)


def test_valid_is_inside_the_image_and_before_the_camera_also_under_autocast():
    references = PillarReferences(GRID, 4, "attitude")
    found = seen(references, 0.1, 0.1)
    u, v = found.pix.unbind(-1)
    inside = (u >= 0) & (u < IMAGE_SIZE[0]) & (v >= 0) & (v < IMAGE_SIZE[1]) & (found.depth_m > 0.1)
    assert found.valid.equal(inside)
    assert 0.2 < found.valid.float().mean() < 0.9
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert seen(references, 0.1, 0.1).pix.equal(found.pix)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"projection": "tilted"}, "projection: 'tilted'"),
        *(({"capacity": share}, f"capacity: {share} ") for share in (0.0, -0.5, 1.1)),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_settings_that_cannot_be_are_refused(settings, key):
    with pytest.raises(UserError, match=rf"^model\.encoder\.{key}"):
        PillarReferences(GRID, 4, **{"projection": "attitude", **settings})


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_capacity_keeps_the_shape_and_lists_what_is_in_view(share):
    references = PillarReferences(GRID, 4, "attitude", capacity=share)
    for attitude in ((0.0, 0.0), (0.2, -0.1), (-0.3, 0.2)):
        found = seen(references, *attitude)
        assert len(found.in_view) == round(share * found.valid.numel())
        listed = found.in_view[found.in_view < found.valid.numel()]
        assert listed.equal(found.valid.flatten().nonzero()[:, 0])


def test_more_in_view_than_the_capacity_is_refused():
    references = PillarReferences(GRID, 4, "attitude", capacity=0.1)
    with pytest.raises(UserError, match=r"capacity: 2\d\d of 400 .* room for 40; give 0\.\d+ or"):
        seen(references, 0.0, 0.0)


def test_padded_index_holds_each_rows_first_places():
    valid = torch.tensor([[0, 1, 1, 0, 1], [0, 0, 0, 0, 0], [1, 1, 1, 1, 1]]).bool()
    assert padded_index(valid, 3).view(3, 3).tolist() == [[1, 2, 4], [15, 15, 15], [10, 11, 12]]
    some, none, every = padded_index(valid, 5).view(3, 5).tolist()
    assert (some, none, every) == ([15, 1, 2, 15, 4], [15] * 5, [10, 11, 12, 13, 14])
