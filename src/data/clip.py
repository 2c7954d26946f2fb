"""One clip on disk: plain files that numpy, pandas and PIL read, written whole or not at all.

``docs/conventions.md`` lists the files. Attitudes are quaternions in ``frames.csv``; every matrix
is derived from them here, so the annotation and the training see the same numbers.
"""

import io
import json
import os
import shutil
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from torch import Tensor

from ..geometry import VoxelGrid, rigid, rotation_from_quat
from .files import OpenArchives, differing_files, flush_to_disk, reading, sha256_of, writing

CLIP_SECONDS = 12.0
# Little compression, so that its artifacts hide no thin structure.
JPEG_QUALITY = 95
# The oldest date that a zip can hold: the time of writing must not change the bytes.
ZIP_DATE = (1980, 1, 1, 0, 0, 0)

# Of labels: 4 takes two and a half times as long, for larger files.
DEFLATE_LEVEL = 3
SUMS = "SHA256SUMS"
# Only with sim.save_aux=true.
AUX = "aux.npz"

FRAME_COLUMNS = ["frame", "time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
FRAME_COLUMNS += ["vx_mps", "vy_mps", "vz_mps", "wx_radps", "wy_radps", "wz_radps"]
FRAME_COLUMNS += ["roll_rad", "pitch_rad", "yaw_rad", "altitude_m"]
ACTOR_COLUMNS = ["frame", "actor_id", "type", "class_id", "x_m", "y_m", "z_m"]
ACTOR_COLUMNS += ["vx_mps", "vy_mps", "vz_mps", "length_m", "width_m", "height_m"]
ACTOR_COLUMNS += ["yaw_rad", "visible_pixels"]

# What ``clip.json`` holds as it is, and as lists of numbers.
_SCALARS = ("town", "weather", "seed", "capture_hz")
_MATRICES = ("pix_from_camera", "body_from_camera")


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
            **{name: getattr(self, name) for name in _SCALARS},
            "image": {"width": self.width, "height": self.height},
            **{name: getattr(self, name).tolist() for name in _MATRICES},
            "grid": {name: list(value) for name, value in vars(self.grid).items()},
        }

    @classmethod
    def from_json(cls, data: dict) -> "ClipMeta":
        return cls(
            **{name: data[name] for name in _SCALARS},
            width=data["image"]["width"],
            height=data["image"]["height"],
            **{name: torch.tensor(data[name], dtype=torch.float64) for name in _MATRICES},
            grid=VoxelGrid(**data["grid"]),
        )


def poses_of(frames: pd.DataFrame) -> Float[Tensor, "t 4 4"]:
    """Returns ``world_from_body`` (float64) of the rows of a ``frames.csv``."""
    quat_xyzw = torch.from_numpy(frames[["qx", "qy", "qz", "qw"]].to_numpy(np.float64, copy=True))
    position_m = torch.from_numpy(frames[["x_m", "y_m", "z_m"]].to_numpy(np.float64, copy=True))
    return rigid(rotation_from_quat(quat_xyzw), position_m)


def unfinished(folder: Path) -> Path:
    """Returns the folder in which a clip lies until it is whole."""
    return folder.with_name(f".{folder.name}.part")


class ClipWriter:
    """Writes one clip under a temporary name and renames it when it is whole.

    Use it as a context manager; leaving it by an exception removes what was written. Identical
    input gives identical bytes. Every `OSError` (a full disk) names the file.
    """

    def __init__(self, folder: Path, meta: ClipMeta) -> None:
        self.folder = folder
        self.meta = meta
        self._part = unfinished(folder)

    def __enter__(self) -> "ClipWriter":
        shutil.rmtree(self._part, ignore_errors=True)
        self._part.mkdir(parents=True)
        self._archives: dict[str, zipfile.ZipFile] = {}
        return self

    def add_image(self, frame: int, image: UInt8[np.ndarray, "h w 3"]) -> None:
        encoded = io.BytesIO()
        Image.fromarray(image).save(encoded, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        self._add("rgb.zip", f"{frame:06d}.jpg", encoded.getvalue(), zipfile.ZIP_STORED)

    def add_labels(
        self, frame: int, semantics: UInt8[np.ndarray, "X Y Z"], visible: Bool[np.ndarray, "X Y Z"]
    ) -> None:
        self._add_array("occupancy.npz", f"semantics_{frame:06d}", semantics)
        self._add_array("occupancy.npz", f"visible_{frame:06d}", visible)

    def add_aux(self, frame: int, **images: np.ndarray) -> None:
        """Adds annotation signals (depth, class, instance), for those who ask for them."""
        for name, image in images.items():
            self._add_array(AUX, f"{name}_{frame:06d}", image)

    def add_tables(self, frames: pd.DataFrame, actors: pd.DataFrame) -> None:
        # pandas prints floats as Python does, so that they round-trip.
        csv = {"index": False, "lineterminator": "\n"}
        self._write("frames.csv", frames[FRAME_COLUMNS].to_csv(**csv))
        self._write("actors.csv", actors[ACTOR_COLUMNS].to_csv(**csv))

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._seal()
        finally:
            for archive in self._archives.values():
                # On a full disk closing fails once more; the first error says all.
                with suppress(OSError):
                    archive.close()
            shutil.rmtree(self._part, ignore_errors=True)

    def _seal(self) -> None:
        """Completes the files, and renames the folder when all of it is on the disk."""
        for name, archive in self._archives.items():
            with writing(self._part / name):
                archive.close()
        self._write("clip.json", json.dumps(self.meta.to_json(), indent=1) + "\n")

        names = sorted(path.name for path in self._part.iterdir())
        sums = "".join(f"{sha256_of(self._part / name)}  {name}\n" for name in names)
        self._write(SUMS, sums)

        # The rename says that the clip is whole, so its bytes must be on the disk before.
        for path in (*self._part.iterdir(), self._part):
            flush_to_disk(path)
        os.rename(self._part, self.folder)

    def _write(self, name: str, text: str) -> None:
        with writing(self._part / name) as path:
            path.write_text(text, encoding="utf-8", newline="\n")

    def _add_array(self, archive: str, name: str, array: np.ndarray) -> None:
        encoded = io.BytesIO()
        np.lib.format.write_array(encoded, np.ascontiguousarray(array), allow_pickle=False)
        self._add(archive, f"{name}.npy", encoded.getvalue(), zipfile.ZIP_DEFLATED)

    def _add(self, archive: str, name: str, content: bytes, compression: int) -> None:
        """Adds a member to an archive, without the time of day in it."""
        with writing(self._part / archive) as path:
            if archive not in self._archives:
                self._archives[archive] = zipfile.ZipFile(path, "w")
            member = zipfile.ZipInfo(name, ZIP_DATE)
            self._archives[archive].writestr(member, content, compression, DEFLATE_LEVEL)


# Of all clips that this process reads.
ARCHIVES = OpenArchives()


class Clip:
    """Reads one clip lazily. Archives are opened on first use, in the process that reads them.

    Every unreadable file raises `UserError` with the file's path.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._key = object()  # of this object's archives: another one may read a clip made anew
        with reading(self.folder / "clip.json") as path:
            self.meta = ClipMeta.from_json(json.loads(path.read_text()))

        self.frames = self._table("frames.csv", FRAME_COLUMNS)
        with reading(self.folder / "frames.csv"):
            count = round(CLIP_SECONDS * self.meta.capture_hz)
            if self.frames["frame"].tolist() != list(range(count)):
                raise ValueError(f"it does not hold the frames 0 to {count - 1}")
            if not np.isfinite(self.frames.to_numpy(np.float64)).all():
                raise ValueError("it holds values that are no numbers")
            self.world_from_body = poses_of(self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def clip_id(self) -> str:
        """``<town>/<clip>``."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    @cached_property
    def actors(self) -> pd.DataFrame:
        return self._table("actors.csv", ACTOR_COLUMNS)

    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        with reading(self.folder / "rgb.zip"):
            encoded = self._archive("rgb.zip").read(f"{frame:06d}.jpg")
            return np.asarray(Image.open(io.BytesIO(encoded)))

    def semantics(self, frame: int) -> UInt8[np.ndarray, "X Y Z"]:
        return self._array("occupancy.npz", f"semantics_{frame:06d}")

    def visible(self, frame: int) -> Bool[np.ndarray, "X Y Z"]:
        return self._array("occupancy.npz", f"visible_{frame:06d}")

    def aux(self, name: str, frame: int) -> np.ndarray:
        """Returns a ``depth`` (m, inf at the sky), ``class`` or ``instance`` image, if saved."""
        return self._array(AUX, f"{name}_{frame:06d}")

    def _array(self, archive: str, name: str) -> np.ndarray:
        with reading(self.folder / archive):
            return self._archive(archive)[name]

    def _archive(self, name: str) -> Any:
        # The images are plain members; all other archives are numpy's.
        opened = zipfile.ZipFile if name == "rgb.zip" else np.load
        return ARCHIVES.get((self._key, name), lambda: opened(self.folder / name))

    def _table(self, name: str, columns: list[str]) -> pd.DataFrame:
        with reading(self.folder / name) as path:
            text = path.read_text(encoding="utf-8")
            # pandas reads a table that ends in the middle of a number without complaint.
            if not text.endswith("\n"):
                raise ValueError("its last line is cut off")
            table = pd.read_csv(io.StringIO(text), float_precision="round_trip")
            if list(table.columns) != columns:
                raise ValueError(f"its columns are not {','.join(columns)}")
            if table.isna().any(axis=None):
                raise ValueError("it has empty cells")
            return table


def recorded_sums(folder: Path) -> dict[str, str]:
    """Returns the SHA-256 of each file by its name, as the clip's own ``SHA256SUMS`` says."""
    with reading(folder / SUMS) as path:
        # Not splitlines(), for which a damaged line feed may end a line too.
        lines = path.read_text().removesuffix("\n").split("\n")
        return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}


def damaged_files(folder: Path) -> list[str]:
    """Names of the clip's files that are missing or whose bytes are not the ones written."""
    return differing_files(folder, recorded_sums(folder))
