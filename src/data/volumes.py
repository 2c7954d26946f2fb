"""Cost volumes of a dataset's frames: computed, and kept beside the clips for a training."""

import os
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from ..atomic import replacing
from ..errors import UserError, reason_of, way_out_of
from ..parallax import Parallax
from ..provenance import digest_of
from ..terminal import say, tracked
from ..used_code import code_of
from ..worker_pool import default_workers, mapped
from .clip import Clip, recorded_sums
from .files import BROKEN

FOLDER = "parallax"
Volume = UInt8[Tensor, "bins h w"]


def volume_of(parallax: Parallax, clip: Clip, now: int, may_see: Callable[[int], bool]) -> Volume:
    """Returns the volume of a frame with the past frames that it may see."""
    past = [now - stride for stride in parallax.strides(clip.meta.capture_hz)]
    seen = [frame for frame in past if may_see(frame)]
    path = file_of(parallax, clip)
    # What is kept is of a whole clip.
    if seen == [frame for frame in past if frame >= 0] and path.is_file():
        return torch.from_numpy(_kept(path, now).copy())
    return computed_volume(parallax, clip, [*seen, now])


def _kept(path: Path, now: int) -> UInt8[np.ndarray, "bins h w"]:
    try:
        return np.load(path, mmap_mode="r")[now]
    except (*BROKEN, IndexError) as error:
        way_out = way_out_of(error, "delete it, and it is computed again", path)
        raise UserError(f"{path}: cannot be read ({reason_of(error)}); {way_out}") from error


def keep_volumes(parallax: Parallax, clips: Sequence[Clip]) -> None:
    """Computes the volumes of all clips that have none yet, on every core.

    Where they cannot be kept, says so; whoever wants one computes it then.
    """
    missing = [clip for clip in clips if not file_of(parallax, clip).is_file()]
    if missing and not _can_be_kept(folder := file_of(parallax, missing[0]).parent):
        say(f"{folder}: cannot be written to, so every epoch compares frames with past ones anew")
        return
    workers = max(1, min(default_workers(), len(missing)))
    kept = mapped(_keep, workers, [parallax] * len(missing), missing)
    for _ in tracked(kept, "comparing frames with past ones", len(missing)):
        pass


def _can_be_kept(folder: Path) -> bool:
    there = next(place for place in (folder, *folder.parents) if place.exists())
    return os.access(there, os.W_OK)


def computed_volume(parallax: Parallax, clip: Clip, window: Sequence[int]) -> Volume:
    """Computes the volume of the last frame of a window with the ones before it."""
    images = [torch.from_numpy(clip.image(frame).copy()).permute(2, 0, 1) for frame in window]
    return parallax.volume(
        images,
        clip.world_from_body[[*window]],
        clip.meta.body_from_camera,
        clip.meta.pix_from_camera.expand(len(window), 3, 3),
    )


@cache
def file_of(parallax: Parallax, clip: Clip) -> Path:
    """Returns the file of a clip's volumes: its name has the settings, then the code and the bytes
    that they are of."""
    of = digest_of([code_of([Parallax.__module__]), recorded_sums(clip.folder)])
    name = f"{clip.clip_id}-{digest_of(parallax.settings)}-{of}.npy"
    return clip.folder.parent.parent / FOLDER / name


def _keep(parallax: Parallax, clip: Clip) -> None:
    past = parallax.strides(clip.meta.capture_hz)
    windows = [[now - n for n in (*past, 0) if n <= now] for now in range(len(clip))]
    volumes = [computed_volume(parallax, clip, window) for window in windows]
    path = file_of(parallax, clip)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, torch.stack(volumes).numpy(), allow_pickle=False)

    # Others with these settings are of other images, poses or code; another rung has settings of
    # its own, and may be in training.
    of_settings, _, _ = path.name.rpartition("-")
    for other in path.parent.glob(f"{of_settings}-*.npy"):
        if other != path:
            other.unlink(missing_ok=True)
