"""Twelve seconds of a recorded flight, as the annotation chain wants a recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from ..data.clip import CLIP_SECONDS, FRAME_COLUMNS, poses_of
from ..geometry import euler_from_rotation, quat_from_euler, transform
from ..ontology import CAR, FREE, GROUND, LARGE_VEHICLE, UNKNOWN, VRU
from ..sim.annotation import FrontView
from ..sim.scene import ScanHits, SceneActor
from ..sim.sensors import Scan
from .flight import ActorTrack, Camera, RecordedFlight

MOVING = (LARGE_VEHICLE, CAR, VRU)
# Of the network's images.
SIDE_PIX = 32
# A point this far outside an actor's box is still on it.
BOX_MARGIN_M = 0.2
# Ground that is farther away than this may lie on another level.
GROUND_WITHIN_M = 25.0
# Every so many frames are looked at for the ground.
GROUND_FRAMES = 20


@dataclass(frozen=True)
class RecordedClip:
    """A part of a recorded flight as a `Recording`; its steps are its own frames.

    ``stride`` frames of the flight are one of the clip, the first of which is ``start``. The world
    is shifted so that its z = 0 is the ground, ``ground_m`` in the flight's. With ``static``
    everything stands still, as in recordings without traffic.
    """

    flight: RecordedFlight
    start: int
    stride: int
    capture_hz: float
    ground_m: float
    static: bool

    def __len__(self) -> int:
        return round(CLIP_SECONDS * self.capture_hz)

    @cached_property
    def camera(self) -> Camera:
        """The camera of the flight, cut to sides that the network takes."""
        left, top, width, height = self._cut
        pix_from_camera = self.flight.camera.pix_from_camera.clone()
        pix_from_camera[:2, 2] -= torch.tensor([left, top], dtype=torch.float64)
        return Camera(pix_from_camera, self.flight.camera.body_from_camera, (width, height))

    @property
    def _cut(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of the middle of an image, of whole multiples of 32."""
        kept = [side - side % SIDE_PIX for side in self.flight.camera.size_pix]
        left, top = ((side - own) // 2 for side, own in zip(self.flight.camera.size_pix, kept))
        return left, top, *kept

    def cut(self, image: np.ndarray) -> np.ndarray:
        """Returns the part of an image of the flight that the clip's camera has."""
        left, top, width, height = self._cut
        return np.ascontiguousarray(image[top : top + height, left : left + width])

    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        return self.cut(self.flight.image(self.frame_of(frame)))

    def frame_of(self, frame: int) -> int:
        """Returns the flight's number of a frame of the clip."""
        return self.start + frame * self.stride

    @cached_property
    def world_from_body(self) -> Float[Tensor, "n 4 4"]:
        poses = self.flight.world_from_body[self.start :: self.stride][: len(self)].clone()
        poses[:, 2, 3] -= self.ground_m
        return poses

    @cached_property
    def frames(self) -> pd.DataFrame:
        return frames_table(self.world_from_body, self.capture_hz)

    @property
    def position_m(self) -> Float[np.ndarray, "n 3"]:
        return self.world_from_body[:, :3, 3].numpy()

    @cached_property
    def actors(self) -> tuple[SceneActor, ...]:
        frames = slice(self.start, self.start + len(self) * self.stride, self.stride)
        tracks = (_actor_of(track, frames, self) for track in self.flight.tracks)
        return tuple(actor for actor in tracks if actor is not None)

    def step_of(self, frame: int) -> int:
        return frame

    def scan_at(self, frame: int) -> int:
        return frame

    def scans(self) -> Iterator[tuple[int, list[Scan]]]:
        for frame in range(len(self)):
            found = self.flight.scans(self.frame_of(frame))
            if not found:
                return
            yield frame, [self._assigned_scan(frame, scan) for scan in found]

    def views(self) -> Iterator[FrontView]:
        # The annotation uses the very transforms that readers of the clip's files will compute.
        mount = self.camera.body_from_camera, self.camera.pix_from_camera
        for frame, world_from_body in enumerate(poses_of(self.frames)):
            number = self.frame_of(frame)
            images = self.flight.depth_m(number), self.flight.class_id(number)
            depth_m, class_id = map(self.cut, images)

            recorded = self.flight.actor_id(number)
            if recorded is None:
                actor_id = np.zeros(class_id.shape, dtype=np.int32)
                actor_id[np.isin(class_id, MOVING) & (not self.static)] = -1
            else:
                actor_id = self.cut(recorded).astype(np.int32)
            # What has no class ends its ray, and gives no point.
            actor_id[class_id == UNKNOWN] = -1
            view = FrontView(world_from_body, *mount, depth_m, class_id, actor_id)
            yield self._assigned_view(frame, view)

    def _assigned_view(self, frame: int, view: FrontView) -> FrontView:
        """Returns a view whose pixels of moving classes are those of the boxes that they lie in."""
        open_pixels = (view.actor_id < 0) & np.isin(view.class_id, MOVING)
        if not (self.actors and open_pixels.any()):
            return view
        whole = view.rays(1, np.inf)
        chosen = open_pixels.reshape(-1)
        view.actor_id[open_pixels] = self._inside(
            frame, whole.points_m(chosen), view.class_id[open_pixels]
        )
        return view

    def _assigned_scan(self, frame: int, scan: Scan) -> Scan:
        """Returns a scan in the clip's world, with the actors in whose boxes it met something."""
        origin_m = scan.origin_m - np.array([0.0, 0.0, self.ground_m])
        hits = scan.hits
        actor_id = hits.actor_id.copy()
        actor_id[hits.class_id >= FREE] = -1

        moved = Scan(origin_m, scan.directions, hits)
        chosen = np.isfinite(hits.distance_m) & np.isin(hits.class_id, MOVING) & (not self.static)
        if chosen.any():
            actor_id[chosen] = self._inside(frame, moved.points_m(chosen), hits.class_id[chosen])
        return Scan(origin_m, scan.directions, ScanHits(hits.distance_m, hits.class_id, actor_id))

    def _inside(
        self, frame: int, points_m: Float[np.ndarray, "k 3"], class_id: UInt8[np.ndarray, "k"]
    ) -> Int[np.ndarray, "k"]:
        """Returns the actor of the points' class in whose box each lies, -1 where there is none."""
        found = np.full(len(points_m), -1, dtype=np.int32)
        for actor in self.actors:
            actor_from_world = np.linalg.inv(actor.world_from_actor[frame])
            away_m = transform(actor_from_world, points_m) - [0, 0, actor.size_m[2] / 2]
            half_m = np.array(actor.size_m) / 2 + BOX_MARGIN_M
            inside = (np.abs(away_m) <= half_m).all(axis=1) & (class_id == actor.class_id)
            found[inside] = actor.actor_id
        return found


def frames_table(world_from_body: Float[Tensor, "n 4 4"], capture_hz: float) -> pd.DataFrame:
    """Returns the rows of a ``frames.csv`` of poses over level ground at z = 0.

    Velocities and rates are differences between the frames before and after.
    """
    rotation, position_m = world_from_body[:, :3, :3], world_from_body[:, :3, 3].numpy()
    angles = euler_from_rotation(rotation)
    velocity_mps = np.gradient(position_m, 1 / capture_hz, axis=0)

    # For small turns the skew part of a rotation is the turn, here over two frames.
    before = torch.cat([rotation[:1], rotation[:-1]])
    after = torch.cat([rotation[1:], rotation[-1:]])
    steps = torch.full((len(rotation),), 2.0, dtype=rotation.dtype)
    steps[[0, -1]] = 1.0
    turn = before.transpose(-1, -2) @ after
    skew = (turn - turn.transpose(-1, -2)) / 2
    rates = torch.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], dim=-1)
    rates_radps = (rates / steps[:, None] * capture_hz).numpy()

    count = np.arange(len(rotation))
    columns = [count, count / capture_hz, *position_m.T, *quat_from_euler(*angles).numpy().T]
    columns += [*velocity_mps.T, *rates_radps.T, *(each.numpy() for each in angles)]
    return pd.DataFrame(dict(zip(FRAME_COLUMNS, [*columns, position_m[:, 2]])))


def ground_of(flight: RecordedFlight) -> float | None:
    """Returns the height of the ground beneath a flight, in its world: the median of the points of
    that class near it. None where no frame shows ground so near."""
    heights_m = []
    for frame in range(0, len(flight.time_s), max(1, len(flight.time_s) // GROUND_FRAMES)):
        mount = flight.camera.body_from_camera, flight.camera.pix_from_camera
        images = flight.depth_m(frame), flight.class_id(frame)
        view = FrontView(flight.world_from_body[frame], *mount, *images, images[1].astype(np.int32))
        rays = view.rays(4, np.inf)
        points_m = rays.points_m(rays.hits.class_id == GROUND)
        away_m = np.linalg.norm((points_m - rays.origin_m)[:, :2], axis=1)
        heights_m.append(points_m[away_m < GROUND_WITHIN_M, 2])

    joined_m = np.concatenate(heights_m)
    return float(np.median(joined_m)) if len(joined_m) else None


def _actor_of(track: ActorTrack, frames: slice, clip: RecordedClip) -> SceneActor | None:
    """Returns an actor over a clip's frames; far below the ground where it is not there."""
    position_m, yaw_rad = track.position_m[frames].copy(), track.yaw_rad[frames].copy()
    there = np.isfinite(position_m).all(axis=1)
    if not there.any():
        return None

    position_m[:, 2] -= clip.ground_m
    steps = np.arange(len(there))
    for axis in range(3):
        position_m[:, axis] = np.interp(steps, steps[there], position_m[there, axis])
    velocity_mps = np.gradient(position_m, 1 / clip.capture_hz, axis=0)
    position_m[~there] = (0.0, 0.0, -1e4)
    yaw_rad[~there] = 0.0
    whats = track.actor_id, track.type, track.class_id, track.size_m
    return SceneActor(*whats, (), position_m, yaw_rad, velocity_mps)
