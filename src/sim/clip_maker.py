"""Makes one clip: flies it, senses it, labels it, writes it. Everything comes from the seed."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8

from ..data.clip import ClipMeta, ClipWriter, poses_of
from ..data.rates import frames_per_clip
from ..errors import UserError
from ..geometry import VoxelGrid, front_mount, pinhole
from .air import apply_weather
from .annotation import FrontView, Labels
from .flight import Flight, FlightConfig
from .observation import Annotator, Observation, actor_table
from .pilot import STEP_HZ
from .scene import Scene, SceneActor
from .sensors import Scan, scan
from .staging import ClipPlan, generator_for, stage_clip
from .traffic import TrafficConfig
from .weather import Weather
from .world import Rendering, World

Config = TypeVar("Config", FlightConfig, TrafficConfig)
Image = UInt8[np.ndarray, "h w 3"]
OnImage = Callable[[int, Image, Rendering], None]


@dataclass(frozen=True)
class SimulatedClip:
    """A clip of the simulator as a `Recording`: its flight, its scene, and its weather."""

    maker: "ClipMaker"
    plan: ClipPlan
    flight: Flight
    scene: Scene
    on_image: OnImage

    @cached_property
    def frames(self) -> pd.DataFrame:
        return self.flight.table(self.capture_hz)

    @property
    def capture_hz(self) -> float:
        return self.maker.sim["capture_hz"]

    @property
    def position_m(self) -> Float[np.ndarray, "t 3"]:
        return self.flight.position_m

    @property
    def actors(self) -> tuple[SceneActor, ...]:
        return self.scene.actors

    def step_of(self, frame: int) -> int:
        return self.maker.step_of(frame)

    def scan_at(self, frame: int) -> int:
        return round(frame * self.maker.sim["lidar_hz"] / self.capture_hz)

    def scans(self) -> Iterator[tuple[int, list[Scan]]]:
        """Runs both LiDARs over the clip."""
        sim = self.maker.sim
        for index in range(frames_per_clip(sim["lidar_hz"])):
            step = round(index * STEP_HZ / sim["lidar_hz"])
            pose = self.flight.world_from_body[step]
            yield step, scan(self.scene, step, pose, sim["lidar_rays"], index, self.maker.range_m)

    def views(self) -> Iterator[FrontView]:
        """Renders every frame, hands its image over, and yields the camera's measurements."""
        maker, plan = self.maker, self.plan
        weather = Weather.of(maker.sim, plan.weather)
        camera = maker.pix_from_camera, *maker.size
        # The annotation uses the very transforms that readers of the clip's files will compute.
        transforms = poses_of(self.frames)
        with World(self.scene, *camera, maker.sim["renderer"]) as world:
            for frame, world_from_body in enumerate(transforms):
                world_from_camera = world_from_body @ maker.body_from_camera
                rendering = world.render(maker.step_of(frame), world_from_camera, weather)

                # Rain and noise differ from frame to frame, and depend on no frame before.
                rng = generator_for(maker.sim["seed"], "air", plan.town, plan.index, frame)
                matrices = world_from_camera, maker.pix_from_camera
                self.on_image(frame, apply_weather(rendering, *matrices, weather, rng), rendering)
                mount = maker.body_from_camera, maker.pix_from_camera
                images = rendering.depth_m, rendering.class_id, rendering.actor_id
                yield FrontView(world_from_body, *mount, *images)


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
        settings = self.range_m, sim["camera_stride"], sim["lidar_hz"]
        self.annotator = Annotator(self.grid, *settings)

    def make(self, plan: ClipPlan, on_frame: Callable[[], None]) -> None:
        """Writes the clip's folder; ``on_frame`` is called as frames are finished."""
        with ClipWriter(self.root / plan.clip_id, self._meta(plan)) as writer:
            observation = self.observe(plan, partial(self._write_images, writer))
            for frame in range(len(observation.views)):
                labels = self.label(observation, frame)
                writer.add_labels(frame, labels.semantics, labels.visible)
                on_frame()
            writer.add_tables(observation.recording.frames, actor_table(observation))

    def stage(self, plan: ClipPlan) -> tuple[Flight, Scene]:
        """Returns the clip's flight, and the scene that it flies through."""
        town_seeds = self.sim.get("town_seeds", 1)
        return stage_clip(plan, self.sim["seed"], self.flight, self.traffic, town_seeds)

    def observe(self, plan: ClipPlan, on_image: OnImage) -> Observation:
        """Flies and films the clip and fuses its scans.

        ``on_image`` is called with every frame's number, image and rendering.
        """
        return self.annotator.observe(SimulatedClip(self, plan, *self.stage(plan), on_image))

    def label(self, observation: Observation, frame: int) -> Labels:
        """Returns the labels of one frame of an observation."""
        return self.annotator.label(observation, frame)

    def step_of(self, frame: int) -> int:
        """Returns the simulation's step at which a frame is captured."""
        return round(frame * STEP_HZ / self.sim["capture_hz"])

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


def _configured(kind: type[Config], key: str, settings: Mapping) -> Config:
    known = [field.name for field in fields(kind)]
    for name in settings:
        if name not in known:
            raise UserError(f"{key}.{name}: there is no such setting; there are {', '.join(known)}")
    return kind(**settings)
