"""Windows of frames, their ego-motion and the order of an epoch."""

import math

import numpy as np
import pytest
import torch

from src.data.batches import Key
from src.data.dataset import OccupancyDataset, history_stride
from src.errors import UserError
from src.geometry import euler_from_rotation, inverse, transform, world_from_occ
from src.ontology import FREE, SKY, UNKNOWN
from tests.data.conftest import assert_same

CLIP = "downtown/clip00"


def window(clips, frame, frames=4, history_step_s=0.2, clip=CLIP, **options):
    return OccupancyDataset(clips, [(clip, frame)], frames, history_step_s, **options)[0]


def test_a_sample_has_the_shapes_and_types_of_the_contract(clips):
    sample = window(clips, 20)
    tensors = {key: value for key, value in sample.items() if torch.is_tensor(value)}
    assert {key: (value.dtype, tuple(value.shape)) for key, value in tensors.items()} == {
        "image": (torch.uint8, (4, 3, 64, 96)),
        "pix_from_camera": (torch.float32, (4, 3, 3)),
        "body_from_camera": (torch.float32, (4, 4)),
        "occ_from_body": (torch.float32, (4, 4, 4)),
        "occ_from_past_occ": (torch.float32, (4, 4, 4)),
        "history_valid": (torch.bool, (4,)),
        "velocity_mps": (torch.float32, (3,)),
        "attitude_rad": (torch.float32, (2,)),
        "height_m": (torch.float32, ()),
        "semantics": (torch.uint8, (25, 25, 15)),
        "visible": (torch.bool, (25, 25, 15)),
    }
    assert (sample["clip"], sample["frame"]) == (CLIP, 20)


@pytest.mark.parametrize(("history_step_s", "stride"), [(0.2, 1), (0.4, 2), (1.0, 5)])
def test_frames_are_the_history_step_apart_oldest_first(clips, history_step_s, stride):
    sample = window(clips, 20, history_step_s=history_step_s)
    for place, age in enumerate((3, 2, 1, 0)):
        image = torch.from_numpy(clips[CLIP].image(20 - stride * age).copy()).permute(2, 0, 1)
        assert torch.equal(sample["image"][place], image)


def test_the_history_step_is_a_time_at_any_capture_rate_and_falls_on_frames():
    for capture_hz in (5, 10, 25):
        assert history_stride(0.2, capture_hz) == capture_hz / 5
    for history_step_s, capture_hz in ((0.2, 2.5), (0.3, 5), (0.0, 5), (-0.2, 5)):
        with pytest.raises(UserError, match=r"data\.history_step_s"):
            history_stride(history_step_s, capture_hz)


@pytest.mark.parametrize("clip", [CLIP, "suburb/clip00"])
def test_a_window_is_padded_where_the_clip_begins_and_not_from_another_clip(clips, clip):
    both = [(name, n) for name in clips for n in range(len(clips[name]))]
    dataset = OccupancyDataset(clips, both, 4, 0.2)
    for frame in range(5):
        sample = dataset[both.index((clip, frame))]
        assert (sample["clip"], sample["frame"]) == (clip, frame)
        assert sample["history_valid"].tolist() == [frame >= age for age in (3, 2, 1, 0)]


@pytest.mark.parametrize(
    ("frame", "seen"),
    [(49, [1, 1, 1, 1]), (50, [0, 0, 0, 1]), (52, [0, 1, 1, 1]), (55, [0, 0, 0, 1])],
)
def test_strict_history_stops_at_a_split_boundary(clips, frame, seen):
    """At 5 Hz validation begins with frame 50 and test with frame 55."""
    assert window(clips, frame, history="strict")["history_valid"].int().tolist() == seen
    assert window(clips, frame, history="open")["history_valid"].all()
    # It does not cut a clip that is held out.
    assert window(clips, frame, history="strict", held_out=[CLIP])["history_valid"].all()
    with pytest.raises(UserError, match=r"data\.history: 'closed'"):
        window(clips, frame, history="closed")


def test_a_resting_point_keeps_its_place_when_the_past_is_aligned(clips):
    """The point as each past occ frame sees it lands on the point as the current one does."""
    frame = 37
    sample = window(clips, frame)
    points_world = torch.tensor([[12.0, 4.0, 0.0], [30.0, -12.0, 5.0], [60.0, 1.0, -2.0]])
    pose = clips[CLIP].world_from_body
    now = transform(inverse(world_from_occ(pose[frame])), points_world.double())
    for place, age in enumerate((3, 2, 1, 0)):
        past = transform(inverse(world_from_occ(pose[frame - age])), points_world.double())
        aligned = transform(sample["occ_from_past_occ"][place].double(), past)
        torch.testing.assert_close(aligned, now, atol=1e-4, rtol=0)
    # Exactly so on some processors; with fused multiplications there is a last bit of float64.
    torch.testing.assert_close(sample["occ_from_past_occ"][-1], torch.eye(4), atol=1e-15, rtol=0)


def test_occ_from_body_holds_each_frame_s_roll_and_pitch_and_no_yaw(clips):
    sample = window(clips, 20)
    angles = torch.stack(euler_from_rotation(sample["occ_from_body"][:, :3, :3].double()), dim=-1)
    table = clips[CLIP].frames.loc[17:20, ["roll_rad", "pitch_rad"]].to_numpy(copy=True)
    torch.testing.assert_close(angles[:, :2], torch.from_numpy(table), atol=1e-6, rtol=0)
    assert angles[:, 2].abs().max() < 1e-6
    assert sample["occ_from_body"][:, :3, 3].abs().max() == 0
    torch.testing.assert_close(sample["attitude_rad"].double(), angles[-1, :2], atol=1e-6, rtol=0)


def test_velocity_is_in_the_occ_frame(clips):
    sample = window(clips, 20)
    row = clips[CLIP].frames.loc[20]
    forward = row["vx_mps"] * math.cos(row["yaw_rad"]) + row["vy_mps"] * math.sin(row["yaw_rad"])
    assert abs(row["yaw_rad"]) > 0.1
    assert sample["velocity_mps"][0].item() == pytest.approx(forward, abs=1e-6)
    speed = math.hypot(*row[["vx_mps", "vy_mps", "vz_mps"]])
    assert sample["velocity_mps"].norm().item() == pytest.approx(speed, abs=1e-6)


def test_a_key_may_mirror_the_sample_and_shorten_its_history(clips):
    dataset = OccupancyDataset(clips, [(CLIP, 20)], 4, 0.2)
    assert torch.equal(dataset[Key(0, mirror=True)]["image"], dataset[0]["image"].flip(-1))
    assert torch.equal(dataset[Key(0)]["image"], dataset[0]["image"])
    for past, valid in ((None, [1, 1, 1, 1]), (0, [0, 0, 0, 1]), (2, [0, 1, 1, 1])):
        assert dataset[Key(0, past=past)]["history_valid"].int().tolist() == valid


def test_without_images_the_past_is_told_by_its_motion(clips):
    whole, light = (window(clips, 20, images=images) for images in (True, False))
    assert_same(light, {**whole, "image": whole["image"][-1:]})


def test_pixels_are_labelled_at_the_centers_of_their_squares(clips, monkeypatch):
    dataset = OccupancyDataset(clips, [(CLIP, 20)], 1, 0.2, pixels=True)
    sample, clip = dataset[0], clips[CLIP]
    class_id, depth_m = clip.aux("class", 20), clip.aux("depth", 20)
    assert sample["pixel_class"].shape == sample["pixel_depth_m"].shape == (16, 24)
    for row, column in ((0, 0), (7, 3), (15, 23), (12, 12)):
        seen = class_id[4 * row + 2, 4 * column + 2]
        assert sample["pixel_class"][row, column] == (FREE if seen == SKY else seen)
        assert sample["pixel_depth_m"][row, column] == depth_m[4 * row + 2, 4 * column + 2]
    assert (sample["pixel_class"] == FREE).any()

    aux, far_m = clip.aux, {"depth": 5.0}
    monkeypatch.setattr(clip, "aux", lambda name, n: np.minimum(aux(name, n), far_m.get(name, 255)))
    assert set(dataset[0]["pixel_class"][sample["pixel_class"] == FREE].tolist()) == {UNKNOWN}
    monkeypatch.undo()

    mirrored = dataset[Key(0, mirror=True)]
    for name in ("pixel_class", "pixel_depth_m"):
        assert torch.equal(mirrored[name], sample[name].flip(-1))
