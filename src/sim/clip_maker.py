"""Makes one clip: flies it, senses it, labels it, writes it. Everything comes from the seed."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from jaxtyping import UInt8

from ..data.clip import ACTOR_COLUMNS, ClipMeta, ClipWriter, poses_of
from ..data.rates import frames_per_clip
from ..errors import UserError
from ..geometry import VoxelGrid, front_mount, pinhole
from .air import apply_weather
from .annotation import FrontView, Labels, label_frame
from .flight import Flight, FlightConfig
from .fusion import ActorMap, StaticMap
from .pilot import STEP_HZ
from .scene import Scene, count_by_actor
from .sensors import scan
from .staging import ClipPlan, generator_for, stage_clip
from .traffic import TrafficConfig
from .weather import Weather
from .world import Rendering, World

# No sensor is mounted farther than this from the UAV's center.
SENSOR_REACH_M = 1.0

Config = TypeVar("Config", FlightConfig, TrafficConfig)
Image = UInt8[np.ndarray, "h w 3"]
OnImage = Callable[[int, Image, Rendering], None]


@dataclass(frozen=True)
class Observation:
    """A clip as it was flown, all that its sensors measured, fused, and by captured frame.

    ``lidar_returns`` counts how often a frame's own scan met each actor.
    """

    frames: pd.DataFrame
    scene: Scene
    static: StaticMap
    actors: ActorMap
    views: list[FrontView]
    lidar_returns: list[dict[int, int]]


class ClipMaker:
    """Makes the clips of one dataset; ``sim`` is the composed ``sim`` configuration.

    Raises `UserError` for settings that cannot be flown, seen or labelled.
    """

    def __init__(self, sim: Mapping, root: Path) -> None:
        self.sim = sim
        self.root = root
        self.grid = VoxelGrid(**sim["grid"])
        self.range_m = float(sim["range_m"])
        self.size = (sim["image"]["width"], sim["image"]["height"])
        self.pix_from_camera = pinhole(*self.size, math.radians(sim["image"]["hfov_deg"]))
        self.body_from_camera = front_mount(
            tuple(sim["camera"]["position_m"]), math.radians(sim["camera"]["pitch_deg"])
        )
        self.flight = _configured(FlightConfig, "sim.flight", sim["flight"])
        self.traffic = _configured(TrafficConfig, "sim.traffic", sim["traffic"])

    def make(self, plan: ClipPlan, on_frame: Callable[[], None]) -> None:
        """Writes the clip's folder; ``on_frame`` is called as frames are finished."""
        with ClipWriter(self.root / plan.clip_id, self._meta(plan)) as writer:
            observation = self.observe(plan, partial(self._write_images, writer))
            for frame in range(len(observation.views)):
                labels = self.label(observation, frame)
                writer.add_labels(frame, labels.semantics, labels.visible)
                on_frame()
            writer.add_tables(observation.frames, self._actor_table(observation))

    def stage(self, plan: ClipPlan) -> tuple[Flight, Scene]:
        """Returns the clip's flight, and the scene that it flies through."""
        town_seeds = self.sim.get("town_seeds", 1)
        return stage_clip(plan, self.sim["seed"], self.flight, self.traffic, town_seeds)

    def observe(self, plan: ClipPlan, on_image: OnImage) -> Observation:
        """Flies and films the clip and fuses its scans.

        ``on_image`` is called with every frame's number, image and rendering.
        """
        flight, scene = self.stage(plan)
        observation = Observation(
            flight.table(self.sim["capture_hz"]), scene, *self._maps(flight), [], []
        )
        returns = self._scan(flight, observation)

        for frame, view in enumerate(self._film(plan, observation, on_image)):
            self._fuse_view(view, frame, observation)
            # A frame's own scan is the one nearest in time.
            nearest = round(frame * self.sim["lidar_hz"] / self.sim["capture_hz"])
            observation.views.append(view)
            observation.lidar_returns.append(returns[min(nearest, len(returns) - 1)])

        observation.static.freeze()
        observation.actors.freeze()
        return observation

    def label(self, observation: Observation, frame: int) -> Labels:
        """Returns the labels of one frame of an observation."""
        view, returns = observation.views[frame], observation.lidar_returns[frame]
        maps = observation.static, observation.actors
        actors_now = observation.scene.actors, self.step_of(frame)
        return label_frame(view, self.grid, *maps, *actors_now, returns)

    def step_of(self, frame: int) -> int:
        """Returns the simulation's step at which a frame is captured."""
        return round(frame * STEP_HZ / self.sim["capture_hz"])

    # ------------------------------------------------------------------------------ annotation

    def _maps(self, flight: Flight) -> tuple[StaticMap, ActorMap]:
        """Returns empty maps over all that the sensors and the grids of a clip can reach."""
        # The grid turns with the UAV's yaw, so its farthest corner may lie in any direction.
        corners_m = np.array([self.grid.lower_m, self.grid.upper_m])
        reach_m = float(np.hypot(*np.abs(corners_m[:, :2]).max(axis=0)))
        below_m = np.array([-reach_m, -reach_m, min(corners_m[0, 2], -SENSOR_REACH_M)])
        above_m = np.array([reach_m, reach_m, max(corners_m[1, 2], SENSOR_REACH_M)])

        lower_m = flight.position_m.min(axis=0) + below_m
        upper_m = flight.position_m.max(axis=0) + above_m
        return StaticMap(lower_m, upper_m, self.grid.voxel_m / 2), ActorMap()

    def _scan(self, flight: Flight, observation: Observation) -> list[dict[int, int]]:
        """Runs both LiDARs over the clip; returns how often each scan met each actor."""
        lidar_returns = []
        for index in range(frames_per_clip(self.sim["lidar_hz"])):
            step = round(index * STEP_HZ / self.sim["lidar_hz"])
            world_from_body, rays = flight.world_from_body[step], self.sim["lidar_rays"]
            scans = scan(observation.scene, step, world_from_body, rays, index, self.range_m)
            for each in scans:
                observation.static.add(each, self.range_m)
                observation.actors.add(each, observation.scene.actors, step)
            actor_id = np.concatenate([each.hits.actor_id for each in scans])
            lidar_returns.append(count_by_actor(actor_id))
        return lidar_returns

    def _fuse_view(self, view: FrontView, frame: int, observation: Observation) -> None:
        """Fuses the camera at no more than the LiDARs' rate.

        All its pixels give points; every ``camera_stride``-th gives the free space along its ray.
        """
        if frame % math.ceil(self.sim["capture_hz"] / self.sim["lidar_hz"]) == 0:
            sparse = view.rays(self.sim["camera_stride"], self.range_m)
            every = view.rays(1, self.range_m)
            observation.static.add(sparse, self.range_m)
            observation.static.add_points(every)
            observation.actors.add(every, observation.scene.actors, self.step_of(frame))

    # -------------------------------------------------------------------------- images, tables

    def _film(
        self, plan: ClipPlan, observation: Observation, on_image: OnImage
    ) -> Iterator[FrontView]:
        """Renders every frame, hands its image over, and yields the camera's measurements."""
        weather = Weather.of(self.sim, plan.weather)
        camera = self.pix_from_camera, *self.size
        # The annotation uses the very transforms that readers of the clip's files will compute.
        transforms = poses_of(observation.frames)
        with World(observation.scene, *camera, self.sim["renderer"]) as world:
            for frame, world_from_body in enumerate(transforms):
                world_from_camera = world_from_body @ self.body_from_camera
                rendering = world.render(self.step_of(frame), world_from_camera, weather)

                # Rain and noise differ from frame to frame, and depend on no frame before.
                rng = generator_for(self.sim["seed"], "air", plan.town, plan.index, frame)
                matrices = world_from_camera, self.pix_from_camera
                on_image(frame, apply_weather(rendering, *matrices, weather, rng), rendering)
                mount = self.body_from_camera, self.pix_from_camera
                images = rendering.depth_m, rendering.class_id, rendering.actor_id
                yield FrontView(world_from_body, *mount, *images)

    def _write_images(
        self, writer: ClipWriter, frame: int, image: Image, rendering: Rendering
    ) -> None:
        writer.add_image(frame, image)
        if self.sim["save_aux"]:
            images = {"class": rendering.class_id, "instance": rendering.actor_id}
            writer.add_aux(frame, depth=rendering.depth_m, **images)

    def _meta(self, plan: ClipPlan) -> ClipMeta:
        width, height = self.size
        return ClipMeta(
            town=plan.town,
            weather=plan.weather,
            seed=self.sim["seed"],
            capture_hz=self.sim["capture_hz"],
            width=width,
            height=height,
            pix_from_camera=self.pix_from_camera,
            body_from_camera=self.body_from_camera,
            grid=self.grid,
        )

    def _actor_table(self, observation: Observation) -> pd.DataFrame:
        """Returns every actor at every frame: the rows of ``actors.csv``."""
        frames = np.arange(len(observation.views))
        steps = [self.step_of(frame) for frame in frames.tolist()]
        visible_pixels = [view.visible_pixels for view in observation.views]

        tables = []
        for actor in observation.scene.actors:
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


def _configured(kind: type[Config], key: str, settings: Mapping) -> Config:
    known = [field.name for field in fields(kind)]
    for name in settings:
        if name not in known:
            raise UserError(f"{key}.{name}: there is no such setting; there are {', '.join(known)}")
    return kind(**settings)
