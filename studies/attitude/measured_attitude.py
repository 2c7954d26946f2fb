"""Roll and pitch as an autopilot might report them: late, with noise, or not at all."""

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from src.data.batch import Batch
from src.data.clip import Clip
from src.geometry import euler_from_rotation, rigid, rotation_from_euler
from src.limits import require_at_least


class MeasuredAttitude:
    """Puts a faulty measurement of roll and pitch in the place of the true one.

    What depends on it is where the camera is said to look (``occ_from_body``, of every frame of the
    queue) and the metadata (``attitude_rad``). Labels and ego-motion stay: the occ frame is that of
    the true attitude.

    Args:
        clips: those whose frames may come.
        step: frames from one of a queue to the next.
        noise_deg: standard deviation of roll and of pitch, independent from frame to frame.
        delay_s: how old the reported attitude is; between frames it is interpolated, and at a
            clip's beginning its first one is held.
        seed: of the noise, which is the same for the same clips, in whatever order.
        level: whether what is reported, before the noise, is a UAV that always flies level.

    Raises `UserError` for a noise or a delay below zero.
    """

    def __init__(
        self,
        clips: Mapping[str, Clip],
        step: int,
        noise_deg: float = 0.0,
        delay_s: float = 0.0,
        seed: int = 0,
        level: bool = False,
    ) -> None:
        settings = {"noise_deg": noise_deg, "delay_s": delay_s}
        require_at_least(0, "task", settings, *settings)

        self.step = step
        # Drawn once for every clip in sorted order, not as batches come.
        generator = torch.Generator().manual_seed(seed)
        self.roll_pitch_rad = {}
        for clip_id, clip in sorted(clips.items()):
            reported = delayed(roll_pitch_of(clip), clip.meta.capture_hz, delay_s)
            # A level UAV is the baseline's belief: the camera never rolls (Eq. 5).
            if level:
                reported = torch.zeros_like(reported)
            noise = torch.randn(reported.shape, generator=generator, dtype=reported.dtype)
            self.roll_pitch_rad[clip_id] = reported + math.radians(noise_deg) * noise

    def __call__(self, batch: Batch) -> Batch:
        """Returns the batch as the autopilot would have reported it."""
        queue = batch["occ_from_body"].shape[1]
        ages = torch.arange(queue - 1, -1, -1) * self.step
        # What lies before the clip does not exist for the network either.
        frames = (torch.as_tensor(batch["frame"])[:, None] - ages).clamp(min=0)
        windows = zip(batch["clip"], frames)
        reported = torch.stack([self.roll_pitch_rad[clip][window] for clip, window in windows])

        roll_rad, pitch_rad = reported.unbind(-1)
        rotation = rotation_from_euler(roll_rad, pitch_rad, torch.zeros_like(roll_rad))
        occ_from_body = rigid(rotation, torch.zeros_like(rotation[..., 0]))

        return {
            **batch,
            "occ_from_body": occ_from_body.to(batch["occ_from_body"]),
            "attitude_rad": reported[:, -1].to(batch["attitude_rad"]),
        }


def roll_pitch_of(clip: Clip) -> Float[Tensor, "t 2"]:
    """Returns the true roll and pitch of every frame in radians."""
    return torch.stack(euler_from_rotation(clip.world_from_body[:, :3, :3])[:2], dim=-1)


def delayed(
    values: Float[Tensor, "t 2"], capture_hz: float, delay_s: float
) -> Float[Tensor, "t 2"]:
    """Returns values of ``delay_s`` before each frame, interpolated linearly between frames."""
    place = torch.arange(len(values), dtype=values.dtype) - delay_s * capture_hz
    # So that a delay of whole frames takes them as they are.
    place = place.mul(1e6).round().div(1e6).clamp(min=0)
    before = place.floor().long()
    after = place.ceil().long()
    return torch.lerp(values[before], values[after], (place - before)[:, None])
