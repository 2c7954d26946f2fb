"""A recording of one clip, fused and labelled: one chain for the simulator and for everybody's."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pandas as pd
from jaxtyping import Float

from ..data.clip import ACTOR_COLUMNS
from ..geometry import VoxelGrid
from .annotation import FrontView, Labels, label_frame
from .fusion import ActorMap, StaticMap
from .scene import SceneActor, count_by_actor
from .sensors import Scan

# No sensor is mounted farther than this from the UAV's center.
SENSOR_REACH_M = 1.0


class Recording(Protocol):
    """One clip as sensors recorded it: the front camera's depth and classes, and further scans.

    ``frames`` are the rows of its ``frames.csv``, ``capture_hz`` their rate. The UAV was at
    ``position_m``, in the world. ``actors`` have a place at every step.
    """

    frames: pd.DataFrame
    capture_hz: float
    position_m: Float[np.ndarray, "n 3"]
    actors: Sequence[SceneActor]

    def scans(self) -> Iterator[tuple[int, list[Scan]]]:
        """Yields in the order of time the step of a scan, and what each sensor beside the front
        camera met then."""

    def views(self) -> Iterator[FrontView]:
        """Yields what the front camera measured, frame by frame."""

    def step_of(self, frame: int) -> int:
        """Returns the step of the actors at which a frame is captured."""

    def scan_at(self, frame: int) -> int:
        """Returns the number of the scan that is nearest to a frame in time."""


@dataclass(frozen=True)
class Observation:
    """A recording and all that its sensors measured, fused, and by frame.

    ``lidar_returns`` counts how often a frame's own scan met each actor.
    """

    recording: Recording
    static: StaticMap
    actors: ActorMap
    views: list[FrontView] = field(default_factory=list)
    lidar_returns: list[dict[int, int]] = field(default_factory=list)


@dataclass(frozen=True)
class Annotator:
    """Fuses recordings and labels their frames in the voxels of a grid.

    Surfaces count within ``range_m``. The camera is fused at ``fused_hz`` at most: all its pixels
    give points, every ``camera_stride``-th the free space along its ray.
    """

    grid: VoxelGrid
    range_m: float
    camera_stride: int
    fused_hz: float

    def observe(self, recording: Recording) -> Observation:
        """Fuses all scans and views of a recording."""
        seen = Observation(recording, *self._maps(recording.position_m))
        returns = [self._fuse_scans(seen, *each) for each in recording.scans()]

        every = math.ceil(recording.capture_hz / self.fused_hz)
        for frame, view in enumerate(recording.views()):
            if frame % every == 0:
                self._fuse_view(seen, frame, view)
            seen.views.append(view)
            # A frame's own scan is the one nearest in time.
            nearest = min(recording.scan_at(frame), len(returns) - 1)
            seen.lidar_returns.append(returns[nearest] if returns else {})

        seen.static.freeze()
        seen.actors.freeze()
        return seen

    def label(self, seen: Observation, frame: int) -> Labels:
        """Returns the labels of one frame of an observation."""
        actors_now = seen.recording.actors, seen.recording.step_of(frame)
        maps, returns = (seen.static, seen.actors), seen.lidar_returns[frame]
        return label_frame(seen.views[frame], self.grid, *maps, *actors_now, returns)

    def _maps(self, position_m: Float[np.ndarray, "n 3"]) -> tuple[StaticMap, ActorMap]:
        """Returns empty maps over all that the sensors and the grids of a clip can reach."""
        # The grid turns with the UAV's yaw, so its farthest corner may lie in any direction.
        corners_m = np.array([self.grid.lower_m, self.grid.upper_m])
        reach_m = float(np.hypot(*np.abs(corners_m[:, :2]).max(axis=0)))
        below_m = np.array([-reach_m, -reach_m, min(corners_m[0, 2], -SENSOR_REACH_M)])
        above_m = np.array([reach_m, reach_m, max(corners_m[1, 2], SENSOR_REACH_M)])

        lower_m = position_m.min(axis=0) + below_m
        upper_m = position_m.max(axis=0) + above_m
        return StaticMap(lower_m, upper_m, self.grid.voxel_m / 2), ActorMap()

    def _fuse_scans(self, seen: Observation, step: int, scans: list[Scan]) -> dict[int, int]:
        """Fuses what was scanned at a step; returns how often each actor was met."""
        for each in scans:
            seen.static.add(each, self.range_m)
            seen.actors.add(each, seen.recording.actors, step)
        return count_by_actor(np.concatenate([each.hits.actor_id for each in scans]))

    def _fuse_view(self, seen: Observation, frame: int, view: FrontView) -> None:
        sparse = view.rays(self.camera_stride, self.range_m)
        every = view.rays(1, self.range_m)
        seen.static.add(sparse, self.range_m)
        seen.static.add_points(every)
        seen.actors.add(every, seen.recording.actors, seen.recording.step_of(frame))


def actor_table(observation: Observation) -> pd.DataFrame:
    """Returns every actor at every frame: the rows of ``actors.csv``."""
    frames = np.arange(len(observation.views))
    steps = [observation.recording.step_of(frame) for frame in frames.tolist()]
    visible_pixels = [view.visible_pixels for view in observation.views]

    tables = []
    for actor in observation.recording.actors:
        transforms, velocity_mps = actor.world_from_actor[steps], actor.velocity_mps[steps]
        columns = {
            "frame": frames,
            "actor_id": actor.actor_id,
            "type": actor.type,
            "class_id": actor.class_id,
            **dict(zip(("x_m", "y_m", "z_m"), transforms[:, :3, 3].T)),
            **dict(zip(("vx_mps", "vy_mps", "vz_mps"), velocity_mps.T)),
            **dict(zip(("length_m", "width_m", "height_m"), actor.size_m)),
            "yaw_rad": np.arctan2(transforms[:, 1, 0], transforms[:, 0, 0]),
            "visible_pixels": [pixels.get(actor.actor_id, 0) for pixels in visible_pixels],
        }
        tables.append(pd.DataFrame(columns))

    # An empty table joined to others would change the types of their columns.
    if not tables:
        return pd.DataFrame(columns=ACTOR_COLUMNS)
    return pd.concat(tables).sort_values(["frame", "actor_id"], ignore_index=True)
