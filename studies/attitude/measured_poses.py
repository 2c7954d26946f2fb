"""Poses as an autopilot might report them: late, with noise, of another moment, too far apart."""

import math
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.utils.data import default_collate

from src.data.batch import Batch, ego_motion
from src.data.clip import Clip
from src.data.dataset import OccupancyDataset
from src.data.volumes import computed_volume
from src.geometry import euler_from_rotation, rigid, rotation_from_euler
from src.limits import require_at_least


@dataclass(frozen=True)
class Fault:
    """What is wrong with the poses that are reported.

    Roll and pitch have noise, independent from frame to frame, of a standard deviation of
    ``noise_deg``, and are ``delay_s`` old; or, before the noise, they are those of a UAV that
    always flies ``level``. Distances are too long by a share of ``distance_off``. The time stamp of
    a frame is off by a standard deviation of ``time_off_s``: its whole pose is that of another
    moment.

    Raises `UserError` for a value below zero.
    """

    noise_deg: float = 0.0
    delay_s: float = 0.0
    level: bool = False
    distance_off: float = 0.0
    time_off_s: float = 0.0

    def __post_init__(self) -> None:
        require_at_least(0, "task", vars(self), *vars(self))

    @property
    def moves(self) -> bool:
        """Whether the occ frame is moved or turned, which roll and pitch do not."""
        return self.distance_off > 0 or self.time_off_s > 0

    def poses(
        self, clip: Clip, noise: Float[Tensor, "t 2"], lateness: Float[Tensor, "t"]
    ) -> Float[Tensor, "t 4 4"]:
        """Returns the ``world_from_body`` that is reported of every frame; ``noise`` and
        ``lateness`` are drawn with a standard deviation of 1."""
        true, capture_hz = pose_of(clip), clip.meta.capture_hz
        place = torch.arange(len(true), dtype=true.dtype)
        place = place - self.time_off_s * capture_hz * lateness
        roll_pitch_rad = interpolated(true[:, 3:5], place - self.delay_s * capture_hz)
        # A level UAV is the baseline's belief: the camera never rolls (Eq. 5).
        if self.level:
            roll_pitch_rad = torch.zeros_like(roll_pitch_rad)
        roll_rad, pitch_rad = (roll_pitch_rad + math.radians(self.noise_deg) * noise).unbind(-1)

        pose = interpolated(true, place)
        position_m, yaw_rad = pose[:, :3], pose[:, 5]
        position_m = position_m + self.distance_off * (position_m - position_m[0])
        return rigid(rotation_from_euler(roll_rad, pitch_rad, yaw_rad), position_m)


class MeasuredPoses:
    """Puts poses with a fault in the place of the true ones.

    What depends on them is where the camera is said to look (``occ_from_body``, of every frame of
    the queue), the metadata (``attitude_rad``), the queue's motion (``occ_from_past_occ``) if the
    fault ``moves`` it, and the cost volume (``parallax``) where frames are compared. Images,
    labels, velocity and height stay. A true report leaves the batch as it is.

    Args:
        dataset: that of the batches; poses are reported of the clips of its samples.
        fault: of the poses.
        seed: of what is drawn, which is the same for the same clips, in whatever order.
    """

    def __init__(self, dataset: OccupancyDataset, fault: Fault, seed: int = 0) -> None:
        self.dataset, self.fault = dataset, fault
        clip_ids = sorted({clip_id for clip_id, _ in dataset.samples})
        clips = [dataset.clips[clip_id] for clip_id in clip_ids]

        # Drawn once for every clip in sorted order, not as batches come.
        generator = torch.Generator().manual_seed(seed)
        draw = partial(torch.randn, generator=generator, dtype=torch.float64)
        noise = [draw(len(clip), 2) for clip in clips]
        lateness = [draw(len(clip)) for clip in clips]
        self.poses = dict(zip(clip_ids, map(fault.poses, clips, noise, lateness)))

    def __call__(self, batch: Batch) -> Batch:
        """Returns the batch as the autopilot would have reported it."""
        if self.fault == Fault():
            return batch
        frames, valid = torch.as_tensor(batch["frame"]), batch["history_valid"]
        windows = zip(batch["clip"], frames.tolist(), valid.tolist())
        told = default_collate([self._told(*window) for window in windows])
        return {**batch, **{key: value.to(batch[key]) for key, value in told.items()}}

    def _told(self, clip_id: str, now: int, valid: list[bool]) -> dict[str, Tensor]:
        """Returns what the poses say of one window."""
        poses = self.poses[clip_id]
        ages = range(len(valid) - 1, -1, -1)
        window = [now - self.dataset.step * age if ok else now for age, ok in zip(ages, valid)]
        motion = ego_motion(poses[window], poses.new_zeros(3))

        told = {key: motion[key] for key in ("occ_from_body", "attitude_rad")}
        # Elsewhere it is the true one, to the last bit.
        if self.fault.moves:
            told["occ_from_past_occ"] = motion["occ_from_past_occ"]
        if self.dataset.parallax is not None:
            told["parallax"] = self._volume(clip_id, now)
        return told

    def _volume(self, clip_id: str, now: int) -> UInt8[Tensor, "bins h w"]:
        """Computes the volume of a frame: what is kept on the disk is of the true poses."""
        parallax, clip = self.dataset.parallax, copy(self.dataset.clips[clip_id])
        clip.world_from_body = self.poses[clip_id]
        past = [now - stride for stride in parallax.strides(clip.meta.capture_hz)]
        seen = [frame for frame in past if self.dataset._may_see(clip_id, now, frame)]
        return computed_volume(parallax, clip, [*seen, now])


def pose_of(clip: Clip) -> Float[Tensor, "t 6"]:
    """Returns position, roll, pitch and yaw of every frame; yaw goes on beyond half a turn."""
    world_from_body = clip.world_from_body
    roll_rad, pitch_rad, yaw_rad = euler_from_rotation(world_from_body[:, :3, :3])
    yaw_rad = torch.from_numpy(np.unwrap(yaw_rad))
    return torch.column_stack([world_from_body[:, :3, 3], roll_rad, pitch_rad, yaw_rad])


def interpolated(values: Float[Tensor, "t n"], place: Float[Tensor, "t"]) -> Float[Tensor, "t n"]:
    """Returns values at places between frames, linearly; the first and the last one are held."""
    # So that a delay of whole frames takes them as they are.
    place = place.mul(1e6).round().div(1e6).clamp(0, len(values) - 1)
    before = place.floor().long()
    after = place.ceil().long()
    return torch.lerp(values[before], values[after], (place - before)[:, None])
