"""Makes one clip: flies it, senses it, labels it, writes it. Everything comes from the seed."""

import math
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, UInt8

from ..data.clip import ACTOR_COLUMNS, CLIP_SECONDS, ClipMeta, ClipWriter, poses_of
from ..errors import UserError
from ..geometry import VoxelGrid, front_mount, pinhole
from ..ontology import ACTOR_TYPES
from .air import Viewpoint, apply_weather
from .annotation import Labels, View, label_frame
from .assets import ACTORS
from .flight import Flight, FlightConfig, fly
from .fusion import ActorMap, StaticMap
from .layout import Town
from .pilot import STEP_HZ
from .scene import Body, Piece, Scene, parts_of, pieces_of, static_parts
from .sensors import Scan, scan
from .towns import build_town
from .traffic import Traffic, TrafficConfig, simulate_traffic
from .weather import Weather
from .world import Rendering, World

DRAWN_RADIUS_M = 90.0
"""Of the town, what lies within this distance of the route is drawn."""

SENSOR_REACH_M = 1.0
"""No sensor is mounted farther than this from the UAV's centre."""

Config = TypeVar("Config", FlightConfig, TrafficConfig)


@dataclass(frozen=True)
class ClipPlan:
    """Which clip: its place in the data set and its conditions."""

    clip_id: str
    town: str
    weather: str
    index: int


@dataclass(frozen=True)
class Place:
    """A town, its meshes, and the whole of it for rays."""

    town: Town
    pieces: tuple[Piece, ...]
    whole: Scene


@dataclass(frozen=True)
class Signals:
    """What was sensed at one captured frame, besides the image."""

    view: View
    lidar_returns: dict[int, int]


@dataclass(frozen=True)
class Observation:
    """A clip as it was flown, and all that its sensors measured, fused."""

    frames: pd.DataFrame
    scene: Scene
    static: StaticMap
    actors: ActorMap
    signals: list[Signals]


OnImage = Callable[[int, UInt8[np.ndarray, "h w 3"], Rendering], None]


def generator_for(seed: int, *names: str | int) -> np.random.Generator:
    """A random generator that depends on the seed and on what it is for, and on nothing else."""
    words = [name if isinstance(name, int) else zlib.crc32(name.encode()) for name in names]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))


@lru_cache(maxsize=2)
def place_of(name: str, seed: int) -> Place:
    """A town, kept for the next clip that is flown there."""
    town = build_town(name, generator_for(seed, "town", name))
    pieces = pieces_of(town)
    return Place(town, pieces, Scene(static_parts(pieces), ()))


class ClipMaker:
    """Makes the clips of one data set; ``sim`` is the composed ``sim`` configuration.

    Raises `UserError` for settings that cannot be flown, seen or labelled.
    """

    def __init__(self, sim: Mapping, root: Path) -> None:
        self.sim = sim
        self.root = root
        self.grid = VoxelGrid(**sim["grid"])
        self.range_m = float(sim["range_m"])
        width, height = sim["image"]["width"], sim["image"]["height"]
        self.size = (width, height)
        self.pix_from_camera = pinhole(width, height, math.radians(sim["image"]["hfov_deg"]))
        mount = sim["camera"]
        self.body_from_camera = front_mount(
            tuple(mount["position_m"]), math.radians(mount["pitch_deg"])
        )
        self.flight = _configured(FlightConfig, "sim.flight", sim["flight"])
        self.traffic = _configured(TrafficConfig, "sim.traffic", sim["traffic"])

    def make(self, plan: ClipPlan, on_frame: Callable[[], None]) -> None:
        """Writes the clip's folder; ``on_frame`` is called as frames are finished."""
        with ClipWriter(self.root / plan.clip_id, self._meta(plan)) as writer:
            seen = self.observe(plan, partial(self._write_images, writer))
            for frame in range(len(seen.signals)):
                labels = self.label(seen, frame)
                writer.add_labels(frame, labels.semantics, labels.visible)
                on_frame()
            writer.add_tables(seen.frames, self._actor_table(seen.scene, seen.signals))

    def observe(self, plan: ClipPlan, on_image: OnImage) -> Observation:
        """Flies and films the clip and fuses its scans; ``on_image`` is given every frame's number,
        image and what was rendered."""
        flight, scene = self.stage(plan)
        frames = frame_table(flight, self.sim["capture_hz"])
        static, actors = self._maps(flight)
        returns = self._scan(flight, scene, static, actors)
        signals = []
        for frame, view in enumerate(self._film(plan, scene, poses_of(frames), on_image)):
            self._fuse_view(view, frame, scene, static, actors)
            signals.append(Signals(view, returns[self._scan_index(frame)]))
        static.freeze()
        actors.freeze()
        return Observation(frames, scene, static, actors, signals)

    def label(self, seen: Observation, frame: int) -> Labels:
        """The labels of one frame of what was observed."""
        signal = seen.signals[frame]
        return label_frame(
            *(signal.view, self.grid, seen.static, seen.actors, seen.scene.bodies),
            *(self.step_of(frame), signal.lidar_returns),
        )

    def _write_images(
        self, writer: ClipWriter, frame: int, image: UInt8[np.ndarray, "h w 3"], shown: Rendering
    ) -> None:
        writer.add_image(frame, image)
        if self.sim["save_aux"]:
            images = {"class": shown.class_id, "instance": shown.actor_id}
            writer.add_aux(frame, depth=shown.depth_m, **images)

    def _meta(self, plan: ClipPlan) -> ClipMeta:
        return ClipMeta(
            plan.town,
            plan.weather,
            self.sim["seed"],
            self.sim["capture_hz"],
            *self.size,
            self.pix_from_camera,
            self.body_from_camera,
            self.grid,
        )

    # ------------------------------------------------------------------------ flight and scene

    def stage(self, plan: ClipPlan) -> tuple[Flight, Scene]:
        """The clip's flight, and the scene that it flies through: town near the route, actors."""
        seed = self.sim["seed"]
        place = place_of(plan.town, seed)
        flight = fly(
            place.town,
            generator_for(seed, "flight", plan.town, plan.index),
            place.whole.cast_static,
            self.flight,
            CLIP_SECONDS,
        )
        traffic = simulate_traffic(
            place.town,
            generator_for(seed, "traffic", plan.town, plan.index),
            self.traffic,
            flight.position_m,
        )
        parts = static_parts(place.pieces, flight.position_m[::STEP_HZ, :2], DRAWN_RADIUS_M)
        return flight, Scene(parts, tuple(bodies_of(traffic)))

    def step_of(self, frame: int) -> int:
        """The simulation's step at which a frame is captured."""
        return round(frame * STEP_HZ / self.sim["capture_hz"])

    def _scan_index(self, frame: int) -> int:
        last = int(CLIP_SECONDS * self.sim["lidar_hz"]) - 1
        return min(last, round(frame * self.sim["lidar_hz"] / self.sim["capture_hz"]))

    # ----------------------------------------------------------------------------- annotation

    def _maps(self, flight: Flight) -> tuple[StaticMap, ActorMap]:
        """Empty maps over the sensors' places and all that the grids of this clip can reach."""
        corners = np.array([self.grid.lower_m, self.grid.upper_m])
        reach_m = float(np.hypot(*np.abs(corners[:, :2]).max(axis=0)))
        below_m = np.array([-reach_m, -reach_m, min(corners[0, 2], -SENSOR_REACH_M)])
        above_m = np.array([reach_m, reach_m, max(corners[1, 2], SENSOR_REACH_M)])
        lower_m = flight.position_m.min(axis=0) + below_m
        upper_m = flight.position_m.max(axis=0) + above_m
        return StaticMap(lower_m, upper_m, self.grid.voxel_m / 2), ActorMap()

    def _scan(
        self, flight: Flight, scene: Scene, static: StaticMap, actors: ActorMap
    ) -> list[dict[int, int]]:
        """Runs both LiDARs over the clip; returns how often each scan met each actor."""
        returns = []
        for index in range(int(CLIP_SECONDS * self.sim["lidar_hz"])):
            step = round(index * STEP_HZ / self.sim["lidar_hz"])
            pose = flight.world_from_body[step]
            scans = scan(scene, step, pose, self.sim["lidar_rays"], index, self.range_m)
            for each in scans:
                self._fuse(each, step, scene, static, actors)
            met = np.concatenate([each.hits.actor_id for each in scans])
            ids, counts = np.unique(met[met > 0], return_counts=True)
            returns.append(dict(zip(ids.tolist(), counts.tolist())))
        return returns

    def _fuse_view(
        self, view: View, frame: int, scene: Scene, static: StaticMap, actors: ActorMap
    ) -> None:
        """Fuses the camera at no more than the LiDARs' rate: points of all its pixels, free space
        along every ``camera_stride``-th of them."""
        if frame % math.ceil(self.sim["capture_hz"] / self.sim["lidar_hz"]) == 0:
            static.add(view.rays(self.sim["camera_stride"], self.range_m), self.range_m)
            every = view.rays(1, self.range_m)
            static.add_points(every)
            actors.add(every, scene.bodies, self.step_of(frame))

    def _fuse(
        self, rays: Scan, step: int, scene: Scene, static: StaticMap, actors: ActorMap
    ) -> None:
        static.add(rays, self.range_m)
        actors.add(rays, scene.bodies, step)

    # -------------------------------------------------------------------------- images, tables

    def _film(
        self,
        plan: ClipPlan,
        scene: Scene,
        world_from_body: Float[torch.Tensor, "t 4 4"],
        on_image: OnImage,
    ) -> Iterator[View]:
        """Renders every frame, hands its image over, and yields what the camera measured."""
        weather = Weather.of(self.sim, plan.weather)
        with World(scene, self.pix_from_camera, *self.size, self.sim["renderer"]) as world:
            for frame, pose in enumerate(world_from_body):
                world_from_camera = pose @ self.body_from_camera
                rendering = world.render(self.step_of(frame), world_from_camera, weather)
                rng = generator_for(self.sim["seed"], "air", plan.town, plan.index, frame)
                viewpoint = Viewpoint.of(world_from_camera, self.pix_from_camera)
                image = apply_weather(rendering, viewpoint, weather, rng)
                on_image(frame, image, rendering)
                seen = (rendering.depth_m, rendering.class_id, rendering.actor_id)
                yield View(pose, self.body_from_camera, self.pix_from_camera, *seen)

    def _actor_table(self, scene: Scene, signals: list[Signals]) -> pd.DataFrame:
        """Every actor at every frame: the rows of ``actors.csv``."""
        steps = [self.step_of(frame) for frame in range(len(signals))]
        tables = []
        for body in scene.bodies:
            pose, velocity_mps = body.world_from_actor[steps], body.velocity_mps[steps]
            pixels = [signal.view.visible_pixels.get(body.actor_id, 0) for signal in signals]
            columns = (
                *(np.arange(len(steps)), body.actor_id, body.type, body.class_id),
                *(*pose[:, :3, 3].T, *velocity_mps.T, *body.size_m),
                *(np.arctan2(pose[:, 1, 0], pose[:, 0, 0]), pixels),
            )
            tables.append(pd.DataFrame(dict(zip(ACTOR_COLUMNS, columns))))
        if not tables:
            return pd.DataFrame(columns=ACTOR_COLUMNS)
        return pd.concat(tables).sort_values(["frame", "actor_id"], ignore_index=True)


def _configured(kind: type[Config], key: str, settings: Mapping) -> Config:
    known = [field.name for field in fields(kind)]
    for name in settings:
        if name not in known:
            raise UserError(f"{key}.{name}: there is no such setting; there are {', '.join(known)}")
    return kind(**settings)


def frame_table(flight: Flight, capture_hz: float) -> pd.DataFrame:
    """The captured steps of a flight as the rows of ``frames.csv``."""
    count = round(CLIP_SECONDS * capture_hz)
    steps = np.round(np.arange(count) * STEP_HZ / capture_hz).astype(int)
    table = pd.DataFrame({"frame": np.arange(count), "time_s": flight.time_s[steps]})
    vectors = {
        ("x_m", "y_m", "z_m"): flight.position_m,
        ("qx", "qy", "qz", "qw"): flight.quat_xyzw,
        ("vx_mps", "vy_mps", "vz_mps"): flight.velocity_mps,
        ("wx_radps", "wy_radps", "wz_radps"): flight.body_rates_radps,
    }
    for names, values in vectors.items():
        table[list(names)] = values[steps]
    for name in ("roll_rad", "pitch_rad", "yaw_rad", "altitude_m"):
        table[name] = getattr(flight, name)[steps]
    return table


def bodies_of(traffic: Traffic) -> list[Body]:
    """The moving actors with their shapes, drawn from each actor's own seed."""
    bodies = []
    for actor in traffic.actors:
        solids = ACTORS[actor.type](np.random.default_rng(actor.seed))
        bodies.append(
            Body(
                actor.actor_id,
                actor.type,
                ACTOR_TYPES[actor.type],
                actor.size_m,
                parts_of(solids),
                upright_poses(actor.position_m, actor.yaw_rad),
                actor.velocity_mps,
            )
        )
    return bodies


def upright_poses(
    position_m: Float[np.ndarray, "t 3"], yaw_rad: Float[np.ndarray, "t"]
) -> Float[np.ndarray, "t 4 4"]:
    """``world_from_actor`` of something that stands upright on its place."""
    poses = np.tile(np.eye(4), (len(yaw_rad), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(yaw_rad)
    poses[:, 1, 0] = np.sin(yaw_rad)
    poses[:, 0, 1] = -poses[:, 1, 0]
    poses[:, :3, 3] = position_m
    return poses
