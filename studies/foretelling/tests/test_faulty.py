"""What each fault does to a frame, in its own unit; none of an amount of zero."""

import math
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid, euler_from_rotation
from src.models.frame import StreamFrame
from studies.foretelling.faulty import FAULTS, Faulty

GRID = VoxelGrid((0.0, -12.5, -10.0), (25.0, 12.5, 5.0), (50, 50, 30))
FOCAL_PIX = 50.0


def frames(count=12):
    rng = np.random.default_rng(0)
    lens = torch.tensor([[FOCAL_PIX, 0, 32], [0, FOCAL_PIX, 24], [0, 0, 1]])
    still = np.zeros(3)
    for n in range(count):
        image = rng.integers(60, 180, (3, 48, 64)).astype(np.uint8)
        yield StreamFrame(image, n / 5, np.eye(4), still, lens, torch.eye(4))


def shown(fault, amount, seed=0, given=None):
    """The frames that a perception is shown of those that are given."""
    shown = Mock(wants_image=True)
    faulty = Faulty("mine", GRID, Mock(return_value=shown), fault, amount, seed)
    faulty.begin(None, "any")
    for frame in given or frames():
        faulty(frame)
    return [call.args[0] for call in shown.call_args_list]


@pytest.mark.parametrize("fault", FAULTS)
def test_nothing_is_at_fault_with_an_amount_of_zero(fault):
    for one, other in zip(shown(fault, 0.0), frames()):
        assert (one.image == other.image).all()
        assert np.allclose(one.world_from_body, other.world_from_body, atol=1e-12)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_flight_is_at_fault_in_the_same_way_again_and_with_another_seed_in_another(fault):
    def told(seed):
        return [(f.image.tobytes(), f.world_from_body.tobytes()) for f in shown(fault, 0.5, seed)]

    assert told(0) == told(0)
    draws = fault not in ("dark", "defocus")
    assert (told(0) != told(1)) == draws


def test_a_stop_too_little_light_halves_the_image():
    for one, other in zip(shown("dark", 1.0), frames()):
        assert np.abs(one.image - other.image / 2.0).max() <= 0.5


def test_noise_has_its_grey_levels_and_is_of_each_frame_its_own():
    pairs = list(zip(shown("noise", 8.0), frames()))
    off = np.stack([one.image.astype(float) - other.image for one, other in pairs])
    assert off.std() == pytest.approx(8.0, rel=0.03)
    assert (off[0] != off[1]).any()


def test_defocus_blurs_by_its_angle():
    """A point becomes a Gaussian of so many pixels."""
    point = np.zeros((3, 48, 64), dtype=np.uint8)
    point[:, 24, 32] = 255
    (frame,) = shown("defocus", 40.0, given=[next(frames())._replace(image=point)])
    weight, rows = frame.image[0].astype(float), np.arange(48) - 24
    spread_pix = math.sqrt((weight.sum(1) * rows**2).sum() / weight.sum())
    assert spread_pix == pytest.approx(40e-3 * FOCAL_PIX, rel=0.2)


def test_dirt_covers_its_share_in_the_same_places():
    pairs = list(zip(shown("dirt", 0.3), frames()))
    covered = [(one.image != other.image).any(0) for one, other in pairs]
    assert covered[0].mean() == pytest.approx(0.3, abs=0.08)
    assert (covered[0] | covered[1]).mean() < covered[0].mean() + 0.02


def test_lost_images_are_replaced_by_the_last_one():
    images = [frame.image.tobytes() for frame in shown("lost", 0.4, given=frames(300))]
    given = [frame.image.tobytes() for frame in frames(300)]
    assert images[0] == given[0]
    lost = [n for n in range(1, 300) if images[n] != given[n]]
    assert all(images[n] == images[n - 1] for n in lost)
    assert len(lost) == pytest.approx(120, abs=25)
    assert all(one.time_s == other.time_s for one, other in zip(shown("lost", 0.4), frames()))


def test_the_attitude_is_off_by_its_angle_in_one_direction():
    matrices = [frame.world_from_body for frame in shown("attitude", 3.0)]
    roll, pitch, yaw = map(float, euler_from_rotation(matrices[0][:3, :3]))
    assert math.degrees(math.hypot(roll, pitch)) == pytest.approx(3.0, rel=0.01)
    assert math.degrees(yaw) == pytest.approx(0.0, abs=0.1)
    assert all((each == matrices[0]).all() for each in matrices)


@pytest.mark.parametrize(
    ("fault", "amount", "match"),
    [("fog", 1.0, "perception.fault"), ("dark", -1.0, "perception.amount"), ("lost", 1.0, "share")],
)
def test_what_is_no_fault_is_refused(fault, amount, match):
    with pytest.raises(UserError, match=match):
        shown(fault, amount)
