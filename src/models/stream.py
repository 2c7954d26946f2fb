"""Streaming inference: one frame and its transform at a time, as in flight."""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ..data.batch import ego_motion
from ..errors import UserError
from ..geometry import Array, require_middle, require_pinhole, require_rigid, tensor_of
from .checkpoint import Checkpoint
from .export import ExportedStep
from .frame import StreamFrame
from .ground import require_height
from .history import History
from .network import SkyOcc

# The benchmark's flights are low; what weights say of higher ones nobody has measured.
HIGHEST_M = 20.0
TOO_HIGH = (
    f"more than {HIGHEST_M:g} m above the ground, higher than the benchmark's flights: do not "
    "trust what is free there, unless the weights were trained so high"
)
# So many frames without a past one are no beginning of a flight.
FRAMES_TO_TELL = 10
# Of the axis of a front camera along the body's, and of anything that flies here.
LEAST_AHEAD, FASTEST_MPS = 0.3, 100.0
SHAPES = {
    "world_from_body": (4, 4),
    "velocity_mps": (3,),
    "pix_from_camera": (3, 3),
    "body_from_camera": (4, 4),
}


class Past(NamedTuple):
    """The part of a frame that a stream keeps."""

    frame: StreamFrame
    pillars: Float[Tensor, "1 p dim"]


class SkyOccStream:
    """Computes the occupancy logits of every frame of a stream once, and keeps the history.

    The numbers are those of `SkyOcc.forward` on the queue of these frames. The camera may be faster
    than the history: of the kept frames, those ``history_step_s`` apart are taken, each within
    ``tolerance_s``. The history is dropped where another clip begins, and where no frame came
    for longer than a history step.

    Args:
        network: a network, which is put into evaluation, or an `ExportedStep`.
        history_step_s: seconds between the frames of a history, as the network was trained with.
        tolerance_s: how far from its time a past frame may have been taken.

    Raises `UserError` for an exported graph whose network had another history step.
    """

    def __init__(
        self, network: SkyOcc | ExportedStep, history_step_s: float, tolerance_s: float = 0.02
    ) -> None:
        self.network = network.eval()
        trained_s = getattr(network, "history_step_s", None)
        if trained_s not in (None, history_step_s):
            raise UserError(f"history_step_s: {history_step_s}; the graph is for {trained_s}")

        self.ages = range(network.past_frames, 0, -1)
        self.step_s, self.tolerance_s = history_step_s, tolerance_s
        self.parallax = network.parallax
        ages_s = () if self.parallax is None else self.parallax.ages_s
        self.reach_s = max(len(self.ages) * history_step_s, *ages_s, 0)

        # Of the images of the training, where that is known.
        self.size_pix: tuple[int, int] | None = None
        self.past: list[Past] = []
        self.clip = ""
        # Times of this clip, until a past frame fits, or until it is told that none does.
        self._without_past_s: list[float] | None = [] if self.reach_s else None

    @classmethod
    def of(
        cls, path: str | Path, tolerance_s: float = 0.02, calibrated: bool = False
    ) -> "SkyOccStream":
        """Returns a stream of a checkpoint's network, at the history step of its training.

        Raises `UserError` as `Checkpoint` does.
        """
        checkpoint = Checkpoint.read(path)
        config = checkpoint.origin.config
        stream = cls(checkpoint.network(calibrated), config["data"]["history_step_s"], tolerance_s)
        stream.size_pix = tuple(config["sim"]["image"][side] for side in ("width", "height"))
        return stream

    def reset(self) -> None:
        """Drops the history."""
        self.past = []

    @torch.no_grad()
    def __call__(self, frame: StreamFrame) -> Float[Tensor, "9 x y z"]:
        """Returns the logits of a frame, in its occ frame.

        Warns of a frame that is too high, and once where no past frame ever fits. Raises
        `UserError`, and leaves the stream as it was, for a frame that is not later than the last
        one of its clip, for an image, a transform, a velocity or a camera of another shape or type,
        not finite, or impossible, and for a UAV below the ground or too high for the network.
        """
        frame = sound(frame)
        if self.size_pix not in (None, size_pix := tuple(frame.image.shape[:0:-1])):
            theirs, ours = ("x".join(map(str, size)) for size in (size_pix, self.size_pix))
            raise UserError(
                f"image: {theirs} pixels, and the network knows {ours}; src.lens.undistorted gives "
                "its image of any camera"
            )
        height_m = frame.world_from_body[2, 3]
        require_height("world_from_body", height_m, self.network.heights_m)
        if height_m > HIGHEST_M:
            warnings.warn(f"world_from_body: {TOO_HIGH}", stacklevel=3)
        logits, pillars = self.network.step(*self.arguments(frame))[:2]
        self._tell_of_no_past(frame)

        kept = (*self._still_valid(frame), Past(frame, pillars))
        oldest_s = frame.time_s - self.reach_s - self.tolerance_s
        self.past = [past for past in kept if past.frame.time_s >= oldest_s]
        self.clip = frame.clip
        return logits[0]

    def arguments(self, frame: StreamFrame) -> tuple[dict[str, Tensor], History | None]:
        """Returns the arguments of the network's step; the stream stays as it is."""
        frame = sound(frame)
        kept = self._still_valid(frame)
        chosen = [self._at(frame.time_s - age * self.step_s, kept) for age in self.ages]
        batch = self._batch(frame, chosen)
        if self.parallax is not None:
            batch["parallax"] = self._volume(frame, kept)[None].to(self.network.device)
        if not chosen:
            return batch, None

        device = self.network.device
        nothing = torch.zeros(1, *self.network.pillar_shape, device=device)
        pillars = [nothing if past is None else past.pillars for past in chosen]
        valid = torch.tensor([[past is not None for past in chosen]], device=device)
        motion = batch["occ_from_past_occ"][:, :-1]
        return batch, History(torch.stack(pillars, dim=1), motion, valid)

    def _tell_of_no_past(self, frame: StreamFrame) -> None:
        """Warns once where frames come at times of which none is a past one of another."""
        if self._without_past_s is None:
            return
        kept, of_parallax = self._still_valid(frame), self.parallax and self.parallax.ages_s
        ages_s = [*(age * self.step_s for age in self.ages), *(of_parallax or ())]
        if any(self._at(frame.time_s - age_s, kept) for age_s in ages_s):
            self._without_past_s = None
            return

        times_s = [*(self._without_past_s if frame.clip == self.clip else ()), frame.time_s]
        self._without_past_s = times_s
        if len(times_s) >= FRAMES_TO_TELL and times_s[-1] - times_s[0] > 2 * self.reach_s:
            self._without_past_s = None
            gap_s = times_s[-1] - times_s[-2]
            warnings.warn(
                f"time_s: no frame has had a past one: the last two are {gap_s:g} s apart, and "
                f"past frames are wanted every {self.step_s:g} s, within {self.tolerance_s:g} s; "
                "give seconds, or another tolerance_s for such a camera",
                stacklevel=4,
            )

    def _still_valid(self, frame: StreamFrame) -> list[Past]:
        """Returns the kept frames that a new frame may use: all of them, or none."""
        if not self.past or frame.clip != self.clip:
            return []
        last_s = self.past[-1].frame.time_s
        gap_s = frame.time_s - last_s
        if gap_s <= 0:
            raise UserError(
                f"time_s: a frame of {frame.time_s:g} s after one of {last_s:g} s; "
                "give frames in order, or reset() the stream"
            )
        return self.past if gap_s <= self.step_s + self.tolerance_s else []

    def _at(self, time_s: float, kept: Sequence[Past]) -> Past | None:
        """Returns the kept frame that was taken then, if there is one."""
        near = [past for past in kept if abs(past.frame.time_s - time_s) <= self.tolerance_s]
        return min(near, key=lambda past: abs(past.frame.time_s - time_s), default=None)

    def _volume(self, frame: StreamFrame, kept: Sequence[Past]) -> UInt8[Tensor, "bins h w"]:
        """Returns the cost volume of a frame with the kept ones that are of parallax's ages."""
        found = [self._at(frame.time_s - age_s, kept) for age_s in reversed(self.parallax.ages_s)]
        frames = [past.frame for past in found if past is not None] + [frame]
        return self.parallax.volume(
            [each.image for each in frames],
            torch.stack([each.world_from_body for each in frames]),
            frame.body_from_camera,
            torch.stack([each.pix_from_camera for each in frames]),
        )

    def _batch(self, frame: StreamFrame, chosen: Sequence[Past | None]) -> dict[str, Tensor]:
        """Returns a batch of one window, whose only image is the current one."""
        # Where a past frame is missing, the current one fills its place: it is never read.
        frames = [past.frame if past else frame for past in chosen] + [frame]
        world_from_body = torch.stack([each.world_from_body for each in frames])
        window = {
            "image": frame.image[None],
            "pix_from_camera": frame.pix_from_camera.float()[None],
            "body_from_camera": frame.body_from_camera.float(),
            **ego_motion(world_from_body, frame.velocity_mps),
        }
        return {name: value[None].to(self.network.device) for name, value in window.items()}


def sound(frame: StreamFrame) -> StreamFrame:
    """Returns a frame with tensors for arrays, and numbers in float64.

    Raises `UserError` for another shape or type, for what is not finite, for a transform that is
    not rigid and a camera that is none.
    """
    if not math.isfinite(frame.time_s):
        raise UserError(f"time_s: {frame.time_s} is not finite; leave this frame out of the stream")
    numbers = {}
    for name, shape in SHAPES.items():
        numbers[name] = value = _tensor(getattr(frame, name)).to(torch.float64)
        if value.shape != shape:
            raise UserError(f"{name}: {list(value.shape)}; give {list(shape)}")
        if not value.isfinite().all():
            raise UserError(
                f"{name}: not finite at {frame.time_s:g} s; leave this frame out of the stream"
            )

    require_rigid("world_from_body", numbers["world_from_body"])
    require_rigid("body_from_camera", numbers["body_from_camera"])
    require_pinhole("pix_from_camera", numbers["pix_from_camera"])
    if numbers["body_from_camera"][0, 2] < LEAST_AHEAD:
        raise UserError(
            "body_from_camera: the camera does not look ahead; its z axis is forward (OpenCV), the "
            "body's is x: take geometry.front_mount, or the inverse of what you gave"
        )
    if (speed_mps := float(numbers["velocity_mps"].norm())) > FASTEST_MPS:
        raise UserError(f"velocity_mps: {speed_mps:g} m/s; give metres a second")

    image = _tensor(frame.image)
    if image.dtype != torch.uint8 or image.ndim != 3 or len(image) != 3:
        kind = f"{str(image.dtype).removeprefix('torch.')} {list(image.shape)}"
        raise UserError(f"image: {kind}; give uint8 [3, height, width]")
    require_middle("pix_from_camera", numbers["pix_from_camera"], (image.shape[2], image.shape[1]))
    return frame._replace(image=image, **numbers)


def _tensor(values: object) -> Tensor:
    """Returns a tensor of an array, a tensor or a list of numbers."""
    return tensor_of(values if isinstance(values, Array) else np.asarray(values))
