"""Layout ``carla``: a folder of images as CARLA saves them, and a JSON of what its API tells.

``<flight>/frames.json`` has ``version``, ``fov_deg``, and of every frame ``time_s``, the
``camera``'s transform and, optionally, the ``actors``: in CARLA's metres and degrees. Images are in
``rgb/``, ``depth/`` and ``semantic/`` or ``instance/``; returns of a semantic LiDAR, optionally, in
``lidar/*.bin``, of which each frame tells the transform as ``lidar``.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from ..data.pictures import files_of, read_channels, require_depth, size_of
from ..errors import UserError, reason_of
from ..geometry import front_mount, pinhole, rigid, rotation_from_euler, transform
from ..ontology import ACTOR_TYPES, UNKNOWN
from ..sim.scene import ScanHits
from ..sim.sensors import Scan
from .classes import ClassTable
from .flight import LEFT_HANDED, ActorTrack, Camera, RecordedFlight, require_frames, require_places
from .plain import FlightOfFiles, folders_with

FRAMES = "frames.json"
# What the three bytes of a depth image reach.
FAR_M = 1000.0
FORM = "docs/own_data.md has an example"
# CARLA's walkers have their origin in the middle of their body.
WALKERS, NO_OFFSET = ("pedestrian",), {"x": 0.0, "y": 0.0, "z": 0.0}
SKY_M = 999.0
# Tags changed here.
FIRST_VERSION = (0, 9, 14)
POINT = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "cos")] + [("index", "<u4"), ("tag", "<u4")]
)


@dataclass
class CarlaFlight(FlightOfFiles):
    """A flight of the layout. ``files`` are its images, by folder; ``lidar`` its poses."""

    world_from_lidar: Sequence[np.ndarray]

    def depth_m(self, frame: int) -> Float[np.ndarray, "h w"]:
        path = self.files["depth"][frame]
        red, green, blue = np.moveaxis(
            read_channels(path, self.camera.size_pix, "RGB").astype(np.float64), -1, 0
        )
        depth_m = (red + 256 * green + 65536 * blue) / (2**24 - 1) * FAR_M
        far = (depth_m >= SKY_M) | self._classes(frame)[1]
        return np.where(far, np.inf, require_depth(path, depth_m)).astype(np.float32)

    def scans(self, frame: int) -> list[Scan]:
        if "lidar" not in self.files:
            return []
        path, world_from_lidar = self.files["lidar"][frame], self.world_from_lidar[frame]
        raw = path.read_bytes()
        if len(raw) % POINT.itemsize:
            raise UserError(f"{path}: is no list of points of {POINT.itemsize} bytes each")

        points = np.frombuffer(raw, POINT)
        # Sensor-local and left-handed, hits only.
        local_m = np.stack([points["x"], -points["y"], points["z"]], axis=1).astype(np.float64)
        away_m = transform(world_from_lidar, local_m) - world_from_lidar[:3, 3]
        distance_m = np.linalg.norm(away_m, axis=1)

        class_id = self.classes.of(path, points["tag"].astype(np.int64)[None])[0][0]
        kept = (distance_m > 0) & (class_id != UNKNOWN)
        directions = away_m[kept] / distance_m[kept, None]
        hits = ScanHits(distance_m[kept], class_id[kept], np.zeros(int(kept.sum()), np.int32))
        return [Scan(world_from_lidar[:3, 3], directions, hits)]

    def _classes(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        path = self.files["class"][frame]
        # The tag is the red channel of semantic and of instance images.
        tags = read_channels(path, self.camera.size_pix, "RGB")[..., 0].astype(np.int64)
        return self.classes.of(path, tags)


@dataclass
class CarlaLayout:
    """Reads the layout ``carla``. ``classes`` lists CARLA's tags, as `ClassTable` takes them."""

    classes: dict

    def flights(self, folder: Path) -> list[RecordedFlight]:
        """Returns the flights of a folder. Raises `UserError` where there is none."""
        return [_flight(each, ClassTable(self.classes)) for each in folders_with(folder, FRAMES)]


def _flight(folder: Path, table: ClassTable) -> CarlaFlight:
    path = folder / FRAMES
    told = _read(path)
    # Such as 0.9.15-dirty.
    version = tuple(map(int, re.findall(r"\d+", str(told["version"]))[:3]))
    if version < FIRST_VERSION:
        raise UserError(
            f"{path}: is of CARLA {told['version']}, whose tags are not those since 0.9.14; "
            "give layout.classes its tags and set version to 0.9.14"
        )

    by_instance = (folder / "instance").is_dir()
    files = {
        "rgb": files_of(folder / "rgb", ".png", ".jpg"),
        "depth": files_of(folder / "depth", ".png"),
        "class": files_of(folder / ("instance" if by_instance else "semantic"), ".png"),
    }
    if (folder / "lidar").is_dir():
        files["lidar"] = files_of(folder / "lidar", ".bin")
    frames = told["frames"]
    require_frames(path, files.values(), len(frames))

    size_pix, place = size_of(files["rgb"][0]), "fov_deg"
    try:
        pix_from_camera = pinhole(*size_pix, np.deg2rad(float(told["fov_deg"])))
        time_s, poses, lidar = np.zeros(len(frames)), [], []
        for number, each in enumerate(frames):
            place = f"frame {number}"
            time_s[number] = float(each["time_s"])
            poses.append(matrix_of(each["camera"]))
            if "lidar" in files:
                lidar.append(matrix_of(each["lidar"]).numpy())
        place, poses = "actors", torch.stack(poses)
        tracks = tracks_of(frames)
    except KeyError as error:
        raise UserError(f"{path}: {place}: lacks {error.args[0]}; {FORM}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise UserError(f"{path}: {place}: {reason_of(error)}; {FORM}") from error

    require_places(path, poses.flatten(1).numpy())
    camera = Camera(pix_from_camera, front_mount((0.0, 0.0, 0.0)), size_pix)
    own = folder.name, folder, time_s, poses, camera
    return CarlaFlight(*own, files, table, lidar, tracks=tracks)


def matrix_of(told: Mapping[str, float]) -> torch.Tensor:
    """Returns our world from an actor's or sensor's own frame, of a transform as CARLA tells it:
    ``x y z`` in metres, ``roll pitch yaw`` in degrees, left-handed; or these in a ``location`` and
    a ``rotation``."""
    told = {**told, **told.get("location", {}), **told.get("rotation", {})}
    angles = [np.deg2rad(float(told[name])) for name in ("roll", "pitch", "yaw")]
    # Mirrored in y, as its place is: roll stays, pitch and yaw turn the other way.
    signed = torch.tensor(angles, dtype=torch.float64) * torch.tensor([1.0, -1.0, -1.0])
    place_m = torch.tensor([float(told[name]) for name in "xyz"], dtype=torch.float64)
    return rigid(rotation_from_euler(*signed), LEFT_HANDED[:3, :3] @ place_m)


def tracks_of(frames: Sequence[Mapping]) -> list[ActorTrack]:
    """Returns the boxes of all actors. ``box`` is a box's middle in its actor's frame: a walker's
    origin is in the middle of its body, a vehicle's on the road."""
    rows: dict[int, dict[int, Mapping]] = {}
    for number, frame in enumerate(frames):
        for actor in frame.get("actors", ()):
            rows.setdefault(int(actor["id"]), {})[number] = actor

    tracks = []
    for actor_id, by_frame in sorted(rows.items()):
        first = next(iter(by_frame.values()))
        kind = str(first["type"])
        size_m = tuple(2 * float(first["extent"][name]) for name in "xyz")
        position_m = np.full((len(frames), 3), np.nan)
        yaw_rad = np.full(len(frames), np.nan)
        for number, actor in by_frame.items():
            world_from_actor = matrix_of(actor.get("transform", actor)).numpy()
            # Where a vehicle's origin is, half of it would be below the road.
            middle = actor.get("box", NO_OFFSET if kind in WALKERS else None)
            if middle is None:
                raise ValueError(f"actor {actor_id} lacks box, its bounding box's location")
            middle = middle.get("location", middle)
            local_m = np.array([[middle["x"], -middle["y"], middle["z"] - size_m[2] / 2]])
            position_m[number] = transform(world_from_actor, local_m)[0]
            yaw_rad[number] = np.arctan2(world_from_actor[1, 0], world_from_actor[0, 0])
        tracks.append(ActorTrack(actor_id, kind, _class_of(kind), size_m, position_m, yaw_rad))
    return tracks


def _class_of(kind: str) -> int:
    if kind not in ACTOR_TYPES:
        raise ValueError(f"actor type {kind!r}; there are {', '.join(ACTOR_TYPES)}")
    return ACTOR_TYPES[kind]


def _read(path: Path) -> dict:
    try:
        told = json.loads(path.read_text())
        if missing := {"version", "fov_deg", "frames"} - set(told):
            raise ValueError(f"no {', '.join(sorted(missing))} in it")
        if not isinstance(told["frames"], list):
            raise ValueError("frames is no list")
        return told
    except (OSError, ValueError, TypeError) as error:
        raise UserError(f"{path}: cannot be read ({reason_of(error)})") from error
