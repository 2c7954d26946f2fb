"""One clip on disk: plain files that numpy, pandas and PIL read, written whole or not at all.

``docs/conventions.md`` lists the files. Poses are stored as quaternions in ``frames.csv``; every
matrix is derived from them here, so the annotation and the training see the same numbers.
"""

import hashlib
import io
import json
import os
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid, rigid, rotation_from_quat

CLIP_SECONDS = 12.0
JPEG_QUALITY = 95
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
SUMS = "SHA256SUMS"

FRAME_COLUMNS = (
    "frame,time_s,x_m,y_m,z_m,qx,qy,qz,qw,vx_mps,vy_mps,vz_mps,wx_radps,wy_radps,wz_radps,"
    "roll_rad,pitch_rad,yaw_rad,altitude_m"
).split(",")
ACTOR_COLUMNS = (
    "frame,actor_id,type,class_id,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,length_m,width_m,height_m,"
    "yaw_rad,visible_pixels"
).split(",")


@dataclass(frozen=True)
class ClipMeta:
    """``clip.json``: what holds for the whole clip. Matrices are float64."""

    town: str
    weather: str
    seed: int
    capture_hz: float
    width: int
    height: int
    pix_from_camera: Float[Tensor, "3 3"]
    body_from_camera: Float[Tensor, "4 4"]
    grid: VoxelGrid

    def to_json(self) -> dict:
        return {
            "town": self.town,
            "weather": self.weather,
            "seed": self.seed,
            "capture_hz": self.capture_hz,
            "image": {"width": self.width, "height": self.height},
            "pix_from_camera": self.pix_from_camera.tolist(),
            "body_from_camera": self.body_from_camera.tolist(),
            "grid": {
                "lower_m": list(self.grid.lower_m),
                "upper_m": list(self.grid.upper_m),
                "shape": list(self.grid.shape),
            },
        }

    @classmethod
    def from_json(cls, data: dict) -> "ClipMeta":
        return cls(
            town=data["town"],
            weather=data["weather"],
            seed=data["seed"],
            capture_hz=data["capture_hz"],
            width=data["image"]["width"],
            height=data["image"]["height"],
            pix_from_camera=torch.tensor(data["pix_from_camera"], dtype=torch.float64),
            body_from_camera=torch.tensor(data["body_from_camera"], dtype=torch.float64),
            grid=VoxelGrid(**data["grid"]),
        )


def poses_of(frames: pd.DataFrame) -> Float[Tensor, "t 4 4"]:
    """``world_from_body`` (float64) of the rows of a ``frames.csv``."""
    quat_xyzw = torch.from_numpy(frames[["qx", "qy", "qz", "qw"]].to_numpy(np.float64, copy=True))
    position_m = torch.from_numpy(frames[["x_m", "y_m", "z_m"]].to_numpy(np.float64, copy=True))
    return rigid(rotation_from_quat(quat_xyzw), position_m)


class ClipWriter:
    """Writes one clip under a temporary name and renames it when it is whole.

    Use it as a context manager; leaving it by an exception removes what was written. Identical
    input gives identical bytes.
    """

    def __init__(self, folder: Path, meta: ClipMeta) -> None:
        self.folder = folder
        self.meta = meta
        self._part = folder.with_name(f".{folder.name}.part")

    def __enter__(self) -> "ClipWriter":
        shutil.rmtree(self._part, ignore_errors=True)
        self._part.mkdir(parents=True)
        self._rgb = zipfile.ZipFile(self._part / "rgb.zip", "w", zipfile.ZIP_STORED)
        self._occupancy = _NpzWriter(self._part / "occupancy.npz")
        self._aux: _NpzWriter | None = None
        return self

    def add_image(self, frame: int, image: UInt8[np.ndarray, "h w 3"]) -> None:
        encoded = io.BytesIO()
        Image.fromarray(image).save(encoded, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        self._rgb.writestr(zipfile.ZipInfo(f"{frame:06d}.jpg", ZIP_DATE), encoded.getvalue())

    def add_labels(
        self,
        frame: int,
        semantics: UInt8[np.ndarray, "X Y Z"],
        visible: Bool[np.ndarray, "X Y Z"],
    ) -> None:
        self._occupancy.add(f"semantics_{frame:06d}", semantics)
        self._occupancy.add(f"visible_{frame:06d}", visible)

    def add_aux(self, frame: int, **images: np.ndarray) -> None:
        """Annotation signals (depth, class, instance) for those who ask for them."""
        self._aux = self._aux or _NpzWriter(self._part / "aux.npz")
        for name, image in images.items():
            self._aux.add(f"{name}_{frame:06d}", image)

    def add_tables(self, frames: pd.DataFrame, actors: pd.DataFrame) -> None:
        frames[FRAME_COLUMNS].to_csv(self._part / "frames.csv", index=False, lineterminator="\n")
        actors[ACTOR_COLUMNS].to_csv(self._part / "actors.csv", index=False, lineterminator="\n")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for archive in (self._rgb, self._occupancy, self._aux):
            if archive is not None:
                archive.close()
        if kind is not None:
            shutil.rmtree(self._part, ignore_errors=True)
            return
        text = json.dumps(self.meta.to_json(), indent=1) + "\n"
        (self._part / "clip.json").write_text(text)
        names = sorted(path.name for path in self._part.iterdir())
        sums = "".join(f"{sha256_of(self._part / name)}  {name}\n" for name in names)
        (self._part / SUMS).write_text(sums)
        os.rename(self._part, self.folder)


class _NpzWriter:
    """An ``.npz`` that grows member by member, without the time of day in it."""

    def __init__(self, path: Path) -> None:
        self._zip = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=4)

    def add(self, name: str, array: np.ndarray) -> None:
        encoded = io.BytesIO()
        np.lib.format.write_array(encoded, np.ascontiguousarray(array), allow_pickle=False)
        member = zipfile.ZipInfo(f"{name}.npy", ZIP_DATE)
        member.compress_type = zipfile.ZIP_DEFLATED
        self._zip.writestr(member, encoded.getvalue())

    def close(self) -> None:
        self._zip.close()


class Clip:
    """Reads one clip lazily. Archives are opened on first use, in the process that reads them.

    Every unreadable file raises `UserError` with the file's path.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        with _reading(self.folder / "clip.json") as path:
            self.meta = ClipMeta.from_json(json.loads(path.read_text()))
        self.frames = self._table("frames.csv", FRAME_COLUMNS)
        self.world_from_body = poses_of(self.frames)
        self._opened_by, self._archives = -1, {}

    def __len__(self) -> int:
        return len(self.frames)

    def __getstate__(self) -> dict:
        return {**self.__dict__, "_opened_by": -1, "_archives": {}}

    @property
    def clip_id(self) -> str:
        """``<town>/<clip>``."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    @cached_property
    def actors(self) -> pd.DataFrame:
        return self._table("actors.csv", ACTOR_COLUMNS)

    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        with _reading(self.folder / "rgb.zip"):
            encoded = self._archive("rgb.zip").read(f"{frame:06d}.jpg")
            return np.asarray(Image.open(io.BytesIO(encoded)))

    def semantics(self, frame: int) -> UInt8[np.ndarray, "X Y Z"]:
        with _reading(self.folder / "occupancy.npz"):
            return self._archive("occupancy.npz")[f"semantics_{frame:06d}"]

    def visible(self, frame: int) -> Bool[np.ndarray, "X Y Z"]:
        with _reading(self.folder / "occupancy.npz"):
            return self._archive("occupancy.npz")[f"visible_{frame:06d}"]

    def aux(self, name: str, frame: int) -> np.ndarray:
        """``depth`` (m, inf at the sky), ``class`` or ``instance`` image; needs sim.save_aux."""
        with _reading(self.folder / "aux.npz"):
            return self._archive("aux.npz")[f"{name}_{frame:06d}"]

    def _archive(self, name: str) -> Any:
        """An open archive of this process: a file position shared with a fork would be corrupt."""
        if self._opened_by != os.getpid():
            self._opened_by, self._archives = os.getpid(), {}
        if name not in self._archives:
            path = self.folder / name
            zipped = name == "rgb.zip"
            self._archives[name] = zipfile.ZipFile(path) if zipped else np.load(path)
        return self._archives[name]

    def _table(self, name: str, columns: list[str]) -> pd.DataFrame:
        with _reading(self.folder / name) as path:
            table = pd.read_csv(path, float_precision="round_trip")
            if list(table.columns) != columns:
                raise ValueError(f"its columns are not {','.join(columns)}")
            return table


def sha256_of(path: Path) -> str:
    with open(path, "rb") as file:
        digest = hashlib.sha256()
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def recorded_sums(folder: Path) -> dict[str, str]:
    """File name to SHA-256, as the clip's own ``SHA256SUMS`` says."""
    with _reading(folder / SUMS) as path:
        lines = path.read_text().splitlines()
        return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}


def damaged_files(folder: Path) -> list[str]:
    """Names of the clip's files that are missing or whose bytes are not the ones written."""
    sums = recorded_sums(folder)
    return [
        name
        for name, digest in sums.items()
        if not (folder / name).is_file() or sha256_of(folder / name) != digest
    ]


@contextmanager
def _reading(path: Path) -> Iterator[Path]:
    """Turns whatever a broken file raises into one line that names it."""
    try:
        yield path
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"{path}: cannot be read ({reason}); delete the folder {path.parent} and run "
            "task=generate to make that clip again"
        ) from error
