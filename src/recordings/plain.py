"""Layout ``plain``: a documented folder for every simulator that has no layout of its own.

``<flight>/poses.csv``, ``camera.json``, and one file a frame, by name in the order of the poses, in
``rgb/``, ``depth/`` and ``class/``; of moving actors, where there are, ``instance/`` and
``actors.csv``.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int, UInt8

from ..data.pictures import files_of, read_array, read_ids, read_rgb, require_depth, size_of
from ..errors import UserError, reason_of
from ..geometry import front_mount, pixel_centers, require_middle, require_pinhole, unproject
from ..limits import require_choice
from ..ontology import OCCUPIED
from .classes import ClassTable
from .flight import AXES, ActorTrack, Camera, RecordedFlight, poses_from, require_frames

POSES, CAMERA, ACTORS = "poses.csv", "camera.json", "actors.csv"
POSE_COLUMNS = ["time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
ACTOR_COLUMNS = ["frame", "actor_id", "type", "class_id", "x_m", "y_m", "z_m", "yaw_rad"]
SIZE = ["length_m", "width_m", "height_m"]
ACTOR_COLUMNS += SIZE
# Columns that hold words.
WORDS = ("type", "ImageFile")
DEPTHS = ("axis", "ray")


@dataclass
class FlightOfFiles(RecordedFlight):
    """A flight whose images are files, by kind, and whose layout tells a frame's ``_classes``."""

    files: dict[str, list[Path]]
    classes: ClassTable

    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        return read_rgb(self.files["rgb"][frame], self.camera.size_pix)

    def class_id(self, frame: int) -> UInt8[np.ndarray, "h w"]:
        return self._classes(frame)[0]


@dataclass
class PlainFlight(FlightOfFiles):
    """A flight of the layout. ``files`` are its images, by folder."""

    depth: str = "axis"

    def depth_m(self, frame: int) -> Float[np.ndarray, "h w"]:
        path = self.files["depth"][frame]
        depth_m = require_depth(path, read_array(path, self.camera.size_pix))
        if self.depth == "ray":
            depth_m = along_axis(depth_m, self.camera)
        return np.where(self._classes(frame)[1], np.float32(np.inf), depth_m)

    def actor_id(self, frame: int) -> Int[np.ndarray, "h w"] | None:
        paths = self.files.get("instance")
        return None if paths is None else read_ids(paths[frame], self.camera.size_pix)

    def _classes(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        path = self.files["class"][frame]
        return self.classes.of(path, read_ids(path, self.camera.size_pix))


@dataclass
class PlainLayout:
    """Reads the layout ``plain``.

    Args:
        classes: a table as `ClassTable` takes it.
        axes: of the poses: ``ours``, ``left_handed`` or ``north_east_down``.
        depth: along the camera's ``axis``, or along the ``ray`` of each pixel.
    """

    classes: dict
    axes: str = "ours"
    depth: str = "axis"
    _table: ClassTable = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_choice("layout.axes", self.axes, tuple(AXES))
        require_choice("layout.depth", self.depth, DEPTHS)
        self._table = ClassTable(self.classes)

    def flights(self, folder: Path) -> list[RecordedFlight]:
        """Returns the flights of a folder. Raises `UserError` where there is none."""
        return [self._flight(each) for each in folders_with(folder, POSES)]

    def _flight(self, folder: Path) -> PlainFlight:
        path = folder / POSES
        table = read_table(path, POSE_COLUMNS)
        values = table[POSE_COLUMNS].to_numpy(np.float64)
        poses = poses_from(path, values[:, 1:4], values[:, 4:], self.axes)
        files = {
            "rgb": files_of(folder / "rgb", ".png", ".jpg", ".jpeg"),
            "depth": files_of(folder / "depth", ".npy", ".png", ".pfm"),
            "class": files_of(folder / "class", ".png"),
        }
        if (folder / "instance").is_dir():
            files["instance"] = files_of(folder / "instance", ".png")
        require_frames(path, files.values(), len(table))

        camera = _camera_of(folder / CAMERA, size_of(files["rgb"][0]))
        tracks = _tracks_of(folder / ACTORS, len(table))
        own = folder.name, folder, values[:, 0], poses, camera
        return PlainFlight(*own, files, self._table, self.depth, tracks=tracks)


def folders_with(folder: Path, *names: str) -> list[Path]:
    """Returns the folder, or those one or two levels below it, that hold one of the names.

    Raises `UserError` where there is none.
    """
    if not folder.is_dir():
        raise UserError(f"recording: {folder} is no folder; name that of the recording")

    places = [folder, *sorted(path for path in folder.glob("*") if path.is_dir())]
    places += sorted(path for path in folder.glob("*/*") if path.is_dir())
    found = [place for place in places if any((place / name).exists() for name in names)]
    if not found:
        raise UserError(
            f"{folder}: no {' or '.join(names)} in it or below it; is it of another layout?"
        )
    return found


def read_table(path: Path, columns: Sequence[str], sep: str = ",") -> pd.DataFrame:
    """Reads a CSV. Raises `UserError` with the file for one that lacks columns or rows."""
    try:
        # A separator at the end of the lines would make the first column an index.
        how = {"float_precision": "round_trip", "skipinitialspace": True, "index_col": False}
        table = pd.read_csv(path, sep=sep, **how)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read ({reason_of(error)})") from error

    table.columns = [str(name).strip() for name in table.columns]
    if missing := [name for name in columns if name not in table]:
        between = "; separate them by commas" if ";" in table.columns[0] else ""
        needed = ", ".join(columns)
        raise UserError(f"{path}: has no column {missing[0]}; it needs {needed}{between}")
    if table.empty:
        raise UserError(f"{path}: has no rows")
    numbers = table[[name for name in columns if name not in WORDS]]
    if not all(kind.kind in "iuf" for kind in numbers.dtypes):
        raise UserError(f"{path}: holds words where there should be numbers; correct it")
    return table


def along_axis(range_m: Float[np.ndarray, "h w"], camera: Camera) -> Float[np.ndarray, "h w"]:
    """Returns depths along a camera's axis of distances along the rays of its pixels."""
    centers = pixel_centers(*camera.size_pix).reshape(-1, 2)
    through = unproject(centers, torch.ones(len(centers)).double(), camera.pix_from_camera)
    return (range_m / through.norm(dim=-1).reshape(range_m.shape).numpy()).astype(np.float32)


def _camera_of(path: Path, size_pix: tuple[int, int]) -> Camera:
    try:
        told = json.loads(path.read_text())
        pix_from_camera = torch.tensor(told["pix_from_camera"], dtype=torch.float64)
        place = told.get("position_m", (0.0, 0.0, 0.0)), told.get("pitch_deg", 0.0)
        mount = front_mount(tuple(map(float, place[0])), np.deg2rad(float(place[1])))
        if pix_from_camera.shape != (3, 3) or mount.shape != (4, 4):
            raise ValueError("pix_from_camera is no 3x3 matrix")
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise UserError(
            f"{path}: cannot be read ({reason_of(error)}); it holds pix_from_camera, 3x3, and may "
            "hold position_m and pitch_deg of the mount"
        ) from error

    require_pinhole(f"{path}: pix_from_camera", pix_from_camera)
    require_middle(f"{path}: pix_from_camera", pix_from_camera, size_pix)
    return Camera(pix_from_camera, mount, size_pix)


def _tracks_of(path: Path, frames: int) -> list[ActorTrack]:
    """Returns the actors of a table in our frames, where there is one."""
    if not path.is_file():
        return []
    table, tracks = read_table(path, ACTOR_COLUMNS), []
    if not (table["actor_id"].dtype.kind == "i" and table["actor_id"].min() > 0):
        raise UserError(f"{path}: actor_id: give whole numbers above 0, as 0 is what stands")
    if (twice := table.duplicated(["frame", "actor_id"])).any():
        raise UserError(f"{path}, line {twice.argmax() + 2}: an actor is twice in one frame")
    if not (table[SIZE] > 0).to_numpy().all():
        raise UserError(f"{path}: {', '.join(SIZE)}: give metres above 0")

    for actor_id, rows in table.groupby("actor_id"):
        first, at = rows.iloc[0], rows["frame"].to_numpy()
        if at.dtype.kind != "i" or at.min() < 0 or at.max() >= frames:
            raise UserError(f"{path}: actor {actor_id} is in frame {at.max()} of {frames}")

        # Compiled code counts votes by class, and would write beyond them.
        if first["class_id"] not in OCCUPIED:
            raise UserError(
                f"{path}: class_id {first['class_id']} of actor {actor_id} is none of 0 to "
                f"{len(OCCUPIED) - 1}; give its class in this project (src/ontology.py)"
            )

        position_m, yaw_rad = np.full((frames, 3), np.nan), np.full(frames, np.nan)
        position_m[at] = rows[["x_m", "y_m", "z_m"]].to_numpy(np.float64)
        yaw_rad[at] = rows["yaw_rad"].to_numpy(np.float64)
        size_m = tuple(float(first[name]) for name in SIZE)
        what = int(actor_id), str(first["type"]), int(first["class_id"])
        tracks.append(ActorTrack(*what, size_m, position_m, yaw_rad))
    return tracks
