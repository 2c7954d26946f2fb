"""A flight as somebody's simulator recorded it, in this project's frames and units."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from ..data.pictures import number_of
from ..errors import UserError
from ..geometry import rigid, rotation_from_quat
from ..sim.sensors import Scan

# Mirrors between the world's and the body's axes of others and ours; each is its own inverse.
LEFT_HANDED = torch.diag(torch.tensor([1.0, -1.0, 1.0, 1.0], dtype=torch.float64))
NORTH_EAST_DOWN = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64))
AXES = {
    "ours": torch.eye(4, dtype=torch.float64),
    "left_handed": LEFT_HANDED,
    "north_east_down": NORTH_EAST_DOWN,
}

# Points are thinned in cubes that are numbered so far.
FARTHEST_M = 50_000.0
# A quaternion that is longer or shorter is no rotation, or its columns are others.
UNIT_TOLERANCE = 1e-2
# The steps between frames may differ from their median by this share of it.
RATE_TOLERANCE = 0.2


@dataclass(frozen=True)
class Camera:
    """A pinhole on the body; ``size_pix`` is width and height. Matrices are float64."""

    pix_from_camera: Float[Tensor, "3 3"]
    body_from_camera: Float[Tensor, "4 4"]
    size_pix: tuple[int, int]


@dataclass(frozen=True)
class ActorTrack:
    """The box of a moving actor, by frame; NaN where it is not there. It stands on its place."""

    actor_id: int
    type: str
    class_id: int
    size_m: tuple[float, float, float]
    position_m: Float[np.ndarray, "n 3"]
    yaw_rad: Float[np.ndarray, "n"]


@dataclass
class RecordedFlight(ABC):
    """A whole recording of one flight: when and where each frame was taken, and its images.

    A layout is a class of this kind. Every method raises `UserError` with the file's name.
    """

    name: str
    folder: Path
    time_s: Float[np.ndarray, "n"]
    world_from_body: Float[Tensor, "n 4 4"]
    camera: Camera
    tracks: Sequence[ActorTrack] = field(default=(), kw_only=True)

    @abstractmethod
    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        """Returns what the front camera saw."""

    @abstractmethod
    def depth_m(self, frame: int) -> Float[np.ndarray, "h w"]:
        """Returns the depth along the front camera's axis, inf where nothing is hit."""

    @abstractmethod
    def class_id(self, frame: int) -> UInt8[np.ndarray, "h w"]:
        """Returns the classes of the front camera's pixels, 255 where none is known."""

    def actor_id(self, frame: int) -> Int[np.ndarray, "h w"] | None:
        """Returns the moving actor of every pixel, 0 for what stands, where it is recorded."""
        return None

    def scans(self, frame: int) -> list[Scan]:
        """Returns what further sensors met at a frame; actor -1 where a moving one is not known."""
        return []


def poses_from(
    path: Path, position_m: Float[np.ndarray, "n 3"], quat_xyzw: Float[np.ndarray, "n 4"], axes: str
) -> Float[Tensor, "n 4 4"]:
    """Returns ``world_from_body`` of recorded places and attitudes, in our frames.

    ``axes`` names theirs. Raises `UserError` with the file for what is no number or no rotation.
    """
    require_places(path, np.concatenate([position_m, quat_xyzw], axis=1))
    off = np.abs(np.linalg.norm(quat_xyzw, axis=1) - 1)
    if off.max() > UNIT_TOLERANCE:
        row = int(off.argmax())
        raise UserError(
            f"{path}: the quaternion of row {row} has a length of {1 + off[row]:.3g}, and a "
            "rotation's is 1; check which columns it is read from"
        )

    pose = rigid(rotation_from_quat(torch.tensor(quat_xyzw)), torch.tensor(position_m))
    return AXES[axes] @ pose @ AXES[axes]


def require_places(path: Path, rows: Float[np.ndarray, "n k"]) -> None:
    """Raises `UserError` for poses that are not finite, and for places too far away; their numbers
    stand in a row a frame."""
    if len(bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))):
        raise UserError(f"{path}: row {bad[0]} of the poses is not finite; leave such frames out")
    if (farthest_m := np.abs(rows).max()) > FARTHEST_M:
        raise UserError(
            f"{path}: places are up to {farthest_m:.3g} m from the origin, and there may be "
            f"{FARTHEST_M:g}; are they metres? Of map coordinates subtract the first place"
        )


def require_rate(path: Path, time_s: Float[np.ndarray, "n"]) -> float:
    """Returns the frames a second. Raises `UserError` for times that are not evenly apart."""
    if len(bad := np.flatnonzero(~np.isfinite(time_s))):
        raise UserError(f"{path}: the time of row {bad[0]} is not finite; correct it")

    steps_s = np.diff(time_s)
    if len(steps_s) == 0 or (steps_s <= 0).any():
        row = int(np.argmax(steps_s <= 0)) + 1 if len(steps_s) else 0
        raise UserError(f"{path}: the time of row {row} is not later than the one before; sort it")

    step_s = float(np.median(steps_s))
    off = np.abs(steps_s - step_s)
    if off.max() > RATE_TOLERANCE * step_s:
        row = int(off.argmax())
        raise UserError(
            f"{path}: rows {row} and {row + 1} are {steps_s[row]:.4g} s apart, and most are "
            f"{step_s:.4g} s; record at a constant rate, or cut the recording there"
        )
    return round((len(time_s) - 1) / float(time_s[-1] - time_s[0]), 3)


def require_frames(path: Path, files: Collection[Sequence[Path]], rows: int) -> None:
    """Raises `UserError` where some folder has not a file for every row of a table of poses, and
    where files of one row have names of different numbers. ``files`` are those of each folder."""
    for of_folder in files:
        if len(of_folder) != rows:
            raise UserError(
                f"{path}: has {rows} poses, and {of_folder[0].parent} has {len(of_folder)} images; "
                "every frame needs both"
            )

    for of_row in zip(*files):
        if len({number_of(each) for each in of_row}) > 1:
            named = ", ".join(f"{each.parent.name}/{each.name}" for each in of_row)
            raise UserError(
                f"{path.parent}: {named} would be one frame; give what belongs to one frame the "
                "same number"
            )
