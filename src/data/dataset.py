"""Frames of clips as samples: a window of L frames with its ego-motion, and the current labels."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.utils.data import Dataset

from ..errors import UserError
from ..limits import require_choice
from ..ontology import FREE, SKY
from ..parallax import RASTER, Parallax
from .batch import Batch, ego_motion, mirrored
from .batches import Key
from .clip import Clip
from .split import part_of_time
from .volumes import volume_of

HISTORY = ("open", "strict")


class OccupancyDataset(Dataset):
    """Samples of one part of the split.

    A window never leaves its clip; it may reach back over a split boundary (inputs only, as in
    flight) unless ``history`` is ``"strict"``. With ``images=False`` the past is told by its motion
    alone, and only the current image is read. With ``pixels`` samples hold what the pixels of the
    current image see. Index with an integer or a `Key`.

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
        images: bool = True,
        pixels: bool = False,
        parallax: Parallax | None = None,
    ) -> None:
        require_choice("data.history", history, HISTORY)

        self.clips, self.samples = clips, list(samples)
        self.frames, self.images, self.pixels = frames, images, pixels
        self.parallax = parallax
        self.history, self.held_out = history, frozenset(held_out)
        self.step = history_stride(history_step_s, clips[self.samples[0][0]].meta.capture_hz)

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, key: int | Key) -> Batch:
        key = key if isinstance(key, Key) else Key(key)
        sample = self._sample(*self.samples[key.index], key.past)
        return mirrored(sample) if key.mirror else sample

    def _sample(self, clip_id: str, now: int, past: int | None) -> Batch:
        clip = self.clips[clip_id]
        ages = range(self.frames - 1, -1, -1)
        wanted = [now - self.step * age for age in ages]

        # What lies before the clip, or in another part, is not there for the network.
        may_see = [self._may_see(clip_id, now, frame) for frame in wanted]
        valid = [ok and (past is None or age <= past) for ok, age in zip(may_see, ages)]
        # The current frame fills the gaps, so that every tensor has its shape.
        window = [frame if ok else now for frame, ok in zip(wanted, valid)]

        read = window if self.images else [now]
        images = {frame: torch.from_numpy(clip.image(frame).copy()) for frame in set(read)}
        labels = pixel_labels(clip, now) if self.pixels else {}
        if self.parallax is not None:
            labels["parallax"] = self._volume(clip_id, now)
        motion = ego_motion(clip.world_from_body[window], velocity_world_mps(clip, now))

        return {
            "image": torch.stack([images[frame].permute(2, 0, 1) for frame in read]),
            "pix_from_camera": clip.meta.pix_from_camera.float().expand(self.frames, 3, 3),
            "body_from_camera": clip.meta.body_from_camera.float(),
            **motion,
            "history_valid": torch.tensor(valid),
            "semantics": torch.from_numpy(clip.semantics(now)),
            "visible": torch.from_numpy(clip.visible(now)),
            **labels,
            "clip": clip_id,
            "frame": now,
        }

    def _volume(self, clip_id: str, now: int) -> UInt8[Tensor, "bins h w"]:
        clip = self.clips[clip_id]
        return volume_of(self.parallax, clip, now, lambda past: self._may_see(clip_id, now, past))

    def _may_see(self, clip_id: str, now: int, frame: int) -> bool:
        if frame < 0:
            return False
        # A clip that is held out has no boundary inside it.
        if self.history == "open" or clip_id in self.held_out:
            return True
        capture_hz = self.clips[clip_id].meta.capture_hz
        return part_of_time(frame / capture_hz) == part_of_time(now / capture_hz)


def pixel_labels(clip: Clip, frame: int) -> dict[str, Tensor]:
    """Returns the class and the z-depth in metres that a frame's pixels see: at the centers of
    squares of `RASTER` pixels, where the sky's class is that of free space and its depth
    infinite. What a recording does not know has a depth, and stays `UNKNOWN`."""
    center = slice(RASTER // 2, None, RASTER)
    class_id = clip.aux("class", frame)[center, center]
    depth_m = clip.aux("depth", frame)[center, center]
    is_sky = (class_id == SKY) & np.isinf(depth_m)
    return {
        "pixel_class": torch.from_numpy(np.where(is_sky, FREE, class_id)),
        "pixel_depth_m": torch.from_numpy(depth_m.copy()),
    }


def history_stride(history_step_s: float, capture_hz: float) -> int:
    """Returns the step in frames. Raises `UserError` where it falls between frames."""
    stride = history_step_s * capture_hz
    if abs(stride - round(stride)) > 1e-6 or round(stride) < 1:
        raise UserError(
            f"data.history_step_s: {history_step_s} s is no multiple of the capture interval "
            f"{1 / capture_hz:g} s; choose one"
        )
    return round(stride)


def velocity_world_mps(clip: Clip, frame: int) -> Float[Tensor, "3"]:
    """Returns the UAV's velocity (float64) in the world frame."""
    row = clip.frames.loc[frame, ["vx_mps", "vy_mps", "vz_mps"]]
    return torch.from_numpy(row.to_numpy(np.float64, copy=True))
