"""What poses that were measured wrongly change in a batch, and what they leave."""

import math
import shutil
from copy import copy

import numpy as np
import pytest
import torch
from torch.utils.data import default_collate

from src.data.clip import Clip
from src.data.dataset import OccupancyDataset
from src.data.volumes import computed_volume, file_of
from src.errors import UserError
from src.geometry import rigid, rotation_from_euler, yaw_of
from src.parallax import Parallax
from studies.attitude.measured_poses import Fault, MeasuredPoses, interpolated, pose_of

FIRST, SECOND = "downtown/clip00", "suburb/clip00"
NOW = (FIRST, 9), (SECOND, 4)
EACH = (
    *(Fault(noise_deg=5.0), Fault(delay_s=0.2), Fault(level=True)),
    *(Fault(distance_off=0.05), Fault(time_off_s=0.05)),
)
PARALLAX = Parallax([0.2, 0.4], bins=12, per_bin=1)


def dataset_of(clips, *samples, **settings):
    settings = {"frames": 3, "history_step_s": 0.4, **settings}
    return OccupancyDataset(clips, samples or NOW, **settings)


def batch_of(clips, *samples, **settings):
    dataset = dataset_of(clips, *samples, **settings)
    return default_collate([dataset[n] for n in range(len(dataset))])


def measured(clips, seed=0, **fault):
    return MeasuredPoses(dataset_of(clips), Fault(**fault), seed)


def changed(batch, reported):
    return {key for key in batch if batch[key] is not reported[key]}


def errors_of(measured, clips):
    """Position, roll, pitch and yaw of all frames as reported, less the true ones."""
    errors = []
    for name, clip in clips.items():
        told = copy(clip)
        told.world_from_body = measured.poses[name]
        errors.append(pose_of(told) - pose_of(clip))
    return torch.stack(errors)


# ---------------------------------------------------------------------------- roll and pitch


@pytest.mark.parametrize(("delay_s", "frames"), [(0.0, 0), (0.4, 2)])
def test_every_frame_of_the_queue_is_told_what_was_true_before(clips, delay_s, frames):
    """Two frames late: the queue's own attitudes, one frame of the queue back."""
    now = ((FIRST, 12), (SECOND, 7))
    batch, before = batch_of(clips, *now), batch_of(clips, *((c, n - frames) for c, n in now))
    reported = measured(clips, delay_s=delay_s)(batch)
    for key in ("occ_from_body", "attitude_rad"):
        torch.testing.assert_close(reported[key], before[key], atol=1e-6, rtol=0)
        assert reported[key].dtype == batch[key].dtype


def test_in_a_queue_without_a_past_is_the_current_frame(clips):
    reported = measured(clips, noise_deg=1.0)(batch_of(clips, (FIRST, 0), (SECOND, 1)))
    for queue in reported["occ_from_body"]:
        assert queue.equal(queue[-1:].expand(3, 4, 4))


def test_told_a_level_attitude_the_camera_is_said_to_look_straight_ahead(clips):
    batch = batch_of(clips)
    reported = measured(clips, level=True)(batch)
    straight = torch.eye(4).expand_as(batch["occ_from_body"])
    torch.testing.assert_close(reported["occ_from_body"], straight, atol=1e-6, rtol=0)
    assert not torch.allclose(batch["occ_from_body"], straight, atol=0.05)
    assert reported["attitude_rad"].eq(0).all()


def test_noise_has_the_size_asked_for_and_belongs_to_the_frame(clips):
    one, five = (measured(clips, seed=3, noise_deg=size) for size in (1.0, 5.0))
    small_deg, error_deg = (
        torch.rad2deg(errors_of(each, clips)[..., 3:5].flatten(0, 1)) for each in (one, five)
    )
    assert 4.0 < error_deg.std() < 6.0
    assert error_deg.mean().abs() < 1.5
    assert torch.corrcoef(error_deg.T)[0, 1].abs() < 0.4, "roll and pitch err apart"
    torch.testing.assert_close(5 * small_deg, error_deg)
    # The queue of one window and the current frame of an earlier one are the same frame.
    later, earlier = (five(batch_of(clips, (SECOND, now))) for now in (9, 7))
    torch.testing.assert_close(later["occ_from_body"][:, -2], earlier["occ_from_body"][:, -1])


# ---------------------------------------------------------------------- distances and times


def test_distances_are_too_long_and_nothing_else_changes(clips):
    batch = batch_of(clips)
    reported = measured(clips, distance_off=0.05)(batch)
    motion, true = reported["occ_from_past_occ"], batch["occ_from_past_occ"]
    torch.testing.assert_close(motion[..., :3, 3], 1.05 * true[..., :3, 3])
    torch.testing.assert_close(motion[..., :3, :3], true[..., :3, :3])
    assert true[:, 0, :3, 3].norm(dim=-1).min() > 1
    for key in ("occ_from_body", "attitude_rad"):
        torch.testing.assert_close(reported[key], batch[key], atol=1e-6, rtol=0)


def test_a_wrong_time_is_another_moment_of_the_whole_pose(clips):
    """The UAV of these clips flies at 2 m/s along x, and is filmed at 5 Hz."""
    errors = errors_of(measured(clips, seed=3, time_off_s=0.05), clips)
    late_s = -errors[:, :, 0] / 2
    assert 0.04 < late_s[:, 1:-1].std() < 0.06
    assert late_s.mean().abs() < 0.015
    assert torch.corrcoef(late_s)[0, 1].abs() < 0.3, "each clip's own"

    for clip, late, error in zip(clips.values(), late_s, errors):
        true = pose_of(clip)
        moment = torch.arange(len(true)) - 5 * late
        torch.testing.assert_close(true + error, interpolated(true, moment), atol=1e-5, rtol=0)
        assert error[:, 3:].abs().amax(dim=0).min() > 0.005, "roll, pitch and yaw"


def test_a_queue_has_the_motion_between_the_poses_that_are_reported(clips):
    wrong = measured(clips, time_off_s=0.05)
    motion = wrong(batch_of(clips))["occ_from_past_occ"]
    for row, (name, now) in enumerate(NOW):
        past, current = (wrong.poses[name][n] for n in (now - 2, now))
        turn = yaw_of(motion[row, 1]) - (yaw_of(past) - yaw_of(current)).float()
        assert turn.abs() < 1e-5
        apart_m = (past - current)[:3, 3].norm().float()
        torch.testing.assert_close(motion[row, 1, :3, 3].norm(), apart_m)
    torch.testing.assert_close(motion[:, 2], torch.eye(4).expand(2, 4, 4), atol=1e-6, rtol=0)


def test_places_between_frames_are_interpolated_and_the_ends_are_held():
    values = torch.tensor([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]])
    place = torch.tensor([0.0, 1.0, 2.0])
    assert interpolated(values, place - 0.5).tolist() == [[0.0, 0.0], [0.5, 1.0], [2.0, 2.0]]
    assert interpolated(values, place - 1 + 1e-8).equal(values[[0, 0, 1]])
    assert interpolated(values, place - 9).equal(values[[0, 0, 0]])
    assert interpolated(values, place + 1).equal(values[[1, 2, 2]])
    assert interpolated(values, place).equal(values)


def test_a_yaw_goes_on_beyond_half_a_turn(clips):
    clip, angle = copy(clips[FIRST]), torch.linspace(3.0, 3.5, 60, dtype=torch.float64)
    turned = rotation_from_euler(0 * angle, 0 * angle, angle)
    clip.world_from_body = rigid(turned, clip.world_from_body[:, :3, 3])
    torch.testing.assert_close(pose_of(clip)[:, 5], angle)


# ------------------------------------------------------------------------------------ parallax


@pytest.fixture(scope="module")
def kept(clips, tmp_path_factory):
    """The clips with volumes on the disk that are all zero."""
    root = tmp_path_factory.mktemp("kept")
    kept = {name: Clip(shutil.copytree(clips[name].folder, root / name)) for name in clips}
    for clip in kept.values():
        path = file_of(PARALLAX, clip)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, np.zeros((len(clip), 12, 16, 24), dtype=np.uint8))
    return kept


@pytest.mark.parametrize("fault", EACH)
def test_images_are_compared_by_the_poses_that_are_reported_and_nothing_is_read_from_the_disk(
    clips, kept, fault
):
    dataset = dataset_of(kept, parallax=PARALLAX)
    batch = default_collate([dataset[n] for n in range(len(NOW))])
    assert not batch["parallax"].any(), "of true poses it is"
    wrong = MeasuredPoses(dataset, fault)
    volumes = wrong(batch)["parallax"]
    for volume, (name, now) in zip(volumes, NOW):
        told, window = copy(clips[name]), [now - 2, now - 1, now]
        told.world_from_body = wrong.poses[name]
        assert volume.equal(computed_volume(PARALLAX, told, window))
        assert not volume.equal(computed_volume(PARALLAX, clips[name], window))


def test_of_level_projection_the_volume_knows_no_roll_and_pitch(clips):
    level = Parallax([0.2, 0.4], bins=12, per_bin=1, projection="level")
    dataset = dataset_of(clips, parallax=level)
    batch = default_collate([dataset[n] for n in range(len(NOW))])
    reported = MeasuredPoses(dataset, Fault(noise_deg=5.0))(batch)
    assert (reported["parallax"].int() - batch["parallax"].int()).abs().max() <= 1


def test_frames_that_a_strict_history_hides_are_not_compared(clips):
    samples = [(FIRST, 50)]
    dataset = dataset_of(clips, *samples, parallax=PARALLAX, history="strict")
    batch = default_collate([dataset[0]])
    assert not MeasuredPoses(dataset, Fault(noise_deg=1.0))(batch)["parallax"].any()


# -------------------------------------------------------------------------------- what it leaves


@pytest.mark.parametrize("fault", EACH)
def test_nothing_but_what_the_poses_say_is_changed(clips, fault):
    batch = batch_of(clips, frames=3)
    told = {"occ_from_body", "attitude_rad"}
    moved = {"occ_from_past_occ"} if fault.distance_off or fault.time_off_s else set()
    assert changed(batch, MeasuredPoses(dataset_of(clips), fault)(batch)) == told | moved


def test_a_true_report_changes_nothing(clips):
    dataset = dataset_of(clips, parallax=PARALLAX)
    batch = default_collate([dataset[n] for n in range(len(NOW))])
    assert changed(batch, MeasuredPoses(dataset, Fault())(batch)) == set()


@pytest.mark.parametrize("kind", ["noise_deg", "time_off_s"])
def test_what_is_drawn_depends_on_its_seed_and_not_on_the_order_of_the_clips(clips, kind):
    first, again, other = (measured(clips, seed, **{kind: 1.0}) for seed in (0, 0, 1))
    backwards = dataset_of(dict(reversed(clips.items())), *reversed(NOW))
    backwards = MeasuredPoses(backwards, Fault(**{kind: 1.0}))
    for name in clips:
        assert first.poses[name].equal(again.poses[name])
        assert first.poses[name].equal(backwards.poses[name])
        assert not first.poses[name].equal(other.poses[name])


@pytest.mark.parametrize(
    "fault",
    [{"noise_deg": -1.0}, {"delay_s": math.nan}, {"distance_off": -0.1}, {"time_off_s": math.inf}],
)
def test_a_fault_below_zero_is_refused(fault):
    (name,) = fault
    with pytest.raises(UserError, match=rf"task\.{name}: .* 0\b"):
        Fault(**fault)
