"""The labels that predictions are scored against, frame by frame."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from ..geometry import VoxelGrid, camera_from_occ, inverse, world_from_occ
from ..limits import require_choice
from .batch import Batch
from .clip import Clip
from .dataset import velocity_world_mps
from .manifest import read_manifest
from .split import PARTS, make_split


class SkyShieldTruth:
    """The labels of one part of a finished dataset.

    The clips of ``val`` and ``test`` that are ``held_out`` may be named; otherwise they are those
    of its manifest. Raises `UserError` for a folder that is none, for a part that there is not, and
    for a held-out clip that there is not.
    """

    def __init__(
        self, root: Path, part: str = "test", held_out: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        require_choice("task.part", part, PARTS)
        self.name = root.name
        manifest = read_manifest(root)
        self.clips = {clip: Clip(root / clip) for clip in manifest["clips"]}
        first = next(iter(self.clips.values()))
        self.grid: VoxelGrid = first.meta.grid

        # A study may hold out other clips than the dataset's default.
        held_out = held_out or manifest["held_out"]
        of_parts = held_out["val"], held_out["test"]
        split = make_split(list(self.clips), len(first), first.meta.capture_hz, *of_parts)
        self.samples, self.unseen = split[part], frozenset(held_out["test"])

    def truth(self, clip_id: str, frame: int) -> dict:
        """Returns one frame as a batch of one."""
        return truth_at(self.clips[clip_id], frame)


def truth_at(clip: Clip, frame: int) -> dict:
    """Returns a frame's labels, velocity and camera, as a `metrics.suite.GroundTruth` of one."""
    meta, world_from_body = clip.meta, clip.world_from_body[frame]
    occ_from_world = inverse(world_from_occ(world_from_body))
    velocity_mps = occ_from_world[:3, :3] @ velocity_world_mps(clip, frame)

    return {
        "clip": [clip.clip_id],
        "semantics": torch.from_numpy(clip.semantics(frame))[None],
        "visible": torch.from_numpy(clip.visible(frame))[None],
        "velocity_mps": velocity_mps[None],
        "camera_from_occ": camera_from_occ(world_from_body, meta.body_from_camera)[None],
        "pix_from_camera": meta.pix_from_camera[None],
        "size_pix": (meta.width, meta.height),
    }


def truth_of(batch: Batch) -> dict:
    """Returns the current frames of a loader's batch, as `truth_at` gives one."""
    return {
        **{key: batch[key] for key in ("clip", "semantics", "visible", "velocity_mps")},
        "camera_from_occ": camera_from_occ(
            batch["occ_from_body"][:, -1], batch["body_from_camera"]
        ),
        "pix_from_camera": batch["pix_from_camera"][:, -1],
        "size_pix": (batch["image"].shape[-1], batch["image"].shape[-2]),
    }
