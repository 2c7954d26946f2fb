"""What a faulty measurement of the attitude changes in a batch, and what it leaves."""

import math

import pytest
import torch
from torch.utils.data import default_collate

from src.data.dataset import OccupancyDataset
from src.errors import UserError
from studies.attitude.measured_attitude import MeasuredAttitude, delayed, roll_pitch_of

FIRST, SECOND = "downtown/clip00", "suburb/clip00"


def batch_of(clips, *samples):
    dataset = OccupancyDataset(clips, samples, frames=3, history_step_s=0.4)
    return default_collate([dataset[n] for n in range(len(samples))])


@pytest.mark.parametrize(("delay_s", "frames"), [(0.0, 0), (0.4, 2)])
def test_every_frame_of_the_queue_is_told_what_was_true_before(clips, delay_s, frames):
    """Two frames late: the queue's own attitudes, one frame of the queue back."""
    now = ((FIRST, 12), (SECOND, 7))
    batch, before = batch_of(clips, *now), batch_of(clips, *((c, n - frames) for c, n in now))
    reported = MeasuredAttitude(clips, step=2, delay_s=delay_s)(batch)
    for key in ("occ_from_body", "attitude_rad"):
        torch.testing.assert_close(reported[key], before[key], atol=1e-6, rtol=0)
        assert reported[key].dtype == batch[key].dtype


def test_told_a_level_attitude_the_camera_is_said_to_look_straight_ahead(clips):
    batch = batch_of(clips, (FIRST, 9), (SECOND, 4))
    reported = MeasuredAttitude(clips, step=2, level=True)(batch)
    straight = torch.eye(4).expand_as(batch["occ_from_body"])
    torch.testing.assert_close(reported["occ_from_body"], straight, atol=1e-6, rtol=0)
    assert not torch.allclose(batch["occ_from_body"], straight, atol=0.05)
    assert reported["attitude_rad"].eq(0).all()


def test_labels_and_motion_stay_as_they_are(clips):
    batch = batch_of(clips, (FIRST, 9))
    reported = MeasuredAttitude(clips, step=2, noise_deg=5.0, delay_s=0.2)(batch)
    changed = {key for key in batch if batch[key] is not reported[key]}
    assert changed == {"occ_from_body", "attitude_rad"}


def test_noise_has_the_size_asked_for_and_belongs_to_the_frame(clips):
    one, five = (MeasuredAttitude(clips, 2, noise_deg=size, seed=3) for size in (1.0, 5.0))
    true = {name: roll_pitch_of(clip) for name, clip in clips.items()}
    error_deg = torch.rad2deg(torch.cat([five.roll_pitch_rad[name] - true[name] for name in clips]))
    assert 4.0 < error_deg.std() < 6.0
    assert error_deg.mean().abs() < 1.5
    assert torch.corrcoef(error_deg.T)[0, 1].abs() < 0.4, "roll and pitch err apart"
    small_deg = torch.rad2deg(torch.cat([one.roll_pitch_rad[n] - true[n] for n in clips]))
    torch.testing.assert_close(5 * small_deg, error_deg)
    # The queue of one window and the current frame of an earlier one are the same frame.
    later, earlier = (five(batch_of(clips, (SECOND, now))) for now in (9, 7))
    torch.testing.assert_close(later["occ_from_body"][:, -2], earlier["occ_from_body"][:, -1])


def test_noise_depends_on_its_seed_and_not_on_the_order_of_the_clips(clips):
    first, again, other = (MeasuredAttitude(clips, 2, 1.0, seed=seed) for seed in (0, 0, 1))
    backwards = MeasuredAttitude(dict(reversed(clips.items())), 2, 1.0, seed=0)
    for name in clips:
        assert first.roll_pitch_rad[name].equal(again.roll_pitch_rad[name])
        assert first.roll_pitch_rad[name].equal(backwards.roll_pitch_rad[name])
        assert not first.roll_pitch_rad[name].equal(other.roll_pitch_rad[name])


def test_a_delay_interpolates_and_holds_the_first():
    values = torch.tensor([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]])
    half = delayed(values, capture_hz=5, delay_s=0.1)
    assert half.tolist() == [[0.0, 0.0], [0.5, 1.0], [2.0, 2.0]]
    assert delayed(values, 5, 0.2).equal(values[[0, 0, 1]])
    assert delayed(values, 5, 9.0).equal(values[[0, 0, 0]])
    assert delayed(values, 5, 0.0).equal(values)


@pytest.mark.parametrize("fault", [{"noise_deg": -1.0}, {"delay_s": math.nan}])
def test_a_fault_below_zero_is_refused(clips, fault):
    (name,) = fault
    with pytest.raises(UserError, match=rf"task\.{name}: .* 0\b"):
        MeasuredAttitude(clips, 2, **fault)
