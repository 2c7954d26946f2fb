"""Frames of clips as samples: a window of L frames with its ego-motion, and the current labels."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from ..errors import UserError
from ..geometry import euler_from_rotation, inverse, occ_from_body, world_from_occ
from .batch import Batch, mirrored
from .clip import Clip
from .split import part_of_time

HISTORY = ("open", "strict")


class OccupancyDataset(Dataset):
    """Samples of one part of the split.

    A window never leaves its clip; it may reach back over a split boundary (inputs only, as in
    flight) unless ``history`` is ``"strict"``. Index with an integer, or with (integer, mirror).

    Raises `UserError` for another ``history``, and as `history_stride` does.
    """

    def __init__(
        self,
        clips: Mapping[str, Clip],
        samples: Sequence[tuple[str, int]],
        frames: int,
        history_step_s: float,
        history: str = "open",
        held_out: Sequence[str] = (),
    ) -> None:
        self.clips = clips
        self.samples = list(samples)
        self.frames = frames
        self.history = history
        self.held_out = frozenset(held_out)
        if history not in HISTORY:
            raise UserError(f"data.history: {history!r}; there are {', '.join(HISTORY)}")
        self.step = history_stride(history_step_s, clips[self.samples[0][0]].meta.capture_hz)

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, key: int | tuple[int, bool]) -> Batch:
        index, mirror = key if isinstance(key, tuple) else (key, False)
        sample = self._sample(*self.samples[index])
        return mirrored(sample) if mirror else sample

    def _sample(self, clip_id: str, now: int) -> Batch:
        clip = self.clips[clip_id]
        wanted = [now - self.step * age for age in reversed(range(self.frames))]
        valid = torch.tensor([self._may_see(clip_id, now, frame) for frame in wanted])
        window = [frame if ok else now for frame, ok in zip(wanted, valid.tolist())]
        world_from_body = clip.world_from_body[window]
        occ_now_from_world = inverse(world_from_occ(world_from_body[-1]))
        roll_rad, pitch_rad, _ = euler_from_rotation(world_from_body[-1, :3, :3])
        velocity_mps = occ_now_from_world[:3, :3] @ velocity_world_mps(clip, now)
        images = {frame: torch.from_numpy(clip.image(frame).copy()) for frame in set(window)}
        return {
            "image": torch.stack([images[frame].permute(2, 0, 1) for frame in window]),
            "pix_from_camera": clip.meta.pix_from_camera.float().expand(self.frames, 3, 3),
            "body_from_camera": clip.meta.body_from_camera.float(),
            "occ_from_body": occ_from_body(world_from_body).float(),
            "occ_from_past_occ": (occ_now_from_world @ world_from_occ(world_from_body)).float(),
            "history_valid": valid,
            "velocity_mps": velocity_mps.float(),
            "attitude_rad": torch.stack([roll_rad, pitch_rad]).float(),
            "semantics": torch.from_numpy(clip.semantics(now)),
            "visible": torch.from_numpy(clip.visible(now)),
            "clip": clip_id,
            "frame": now,
        }

    def _may_see(self, clip_id: str, now: int, frame: int) -> bool:
        if frame < 0:
            return False
        if self.history == "open" or clip_id in self.held_out:
            return True
        capture_hz = self.clips[clip_id].meta.capture_hz
        return part_of_time(frame / capture_hz) == part_of_time(now / capture_hz)


def history_stride(history_step_s: float, capture_hz: float) -> int:
    """Frames between two of a window; `UserError` where the step falls between frames."""
    stride = history_step_s * capture_hz
    if abs(stride - round(stride)) > 1e-6 or round(stride) < 1:
        raise UserError(
            f"data.history_step_s: {history_step_s} s is no multiple of the capture interval "
            f"{1 / capture_hz:g} s; choose one"
        )
    return round(stride)


def velocity_world_mps(clip: Clip, frame: int) -> Float[Tensor, "3"]:
    """The UAV's velocity (float64) in the world frame."""
    row = clip.frames.loc[frame, ["vx_mps", "vy_mps", "vz_mps"]]
    return torch.from_numpy(row.to_numpy(np.float64, copy=True))


class EpochSampler(Sampler):
    """A new order every epoch, and a coin for the mirror, from the seed and the epoch alone.

    So a resumed run sees what the undisturbed one would have seen.
    """

    def __init__(self, length: int, seed: int, mirror: bool) -> None:
        self.length = length
        self.seed = seed
        self.mirror = mirror
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Called by the trainer at the start of every epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[tuple[int, bool]]:
        rng = np.random.default_rng([self.seed, self.epoch])
        order = rng.permutation(self.length).tolist()
        coins = rng.random(self.length) < 0.5 if self.mirror else np.zeros(self.length, bool)
        return iter(zip(order, coins.tolist()))
