"""Layout ``airsim``: what AirSim's own recording leaves, ``airsim_rec.txt`` and ``images/``.

It must hold three images of one camera a row: scene (0), depth along the axis (1) or the ray (2) as
``.pfm``, and segmentation (5). Pause the simulator for every row, or its poses are out of step.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..data.pictures import read_array, read_channels, require_depth, size_of
from ..errors import UserError
from ..geometry import front_mount, pinhole
from .classes import ClassTable
from .flight import Camera, RecordedFlight, poses_from
from .plain import FlightOfFiles, along_axis, folders_with, read_table

TABLE, PALETTE = "airsim_rec.txt", "seg_rgbs.txt"
PLACE = ["POS_X", "POS_Y", "POS_Z"]
QUAT_XYZW = ["Q_X", "Q_Y", "Q_Z", "Q_W"]
# By AirSim's numbers of its kinds of image.
KINDS = {"0": "rgb", "1": "depth", "2": "range", "5": "class"}
# The sky sphere of its environments is this far away or farther.
SKY_M = 1000.0


@dataclass
class AirSimFlight(FlightOfFiles):
    """A recording. ``files`` are its images by kind; ``ids`` the class id of a packed color."""

    ids: dict[int, int]

    def depth_m(self, frame: int) -> Float[np.ndarray, "h w"]:
        by_ray = "range" in self.files
        path = self.files["range" if by_ray else "depth"][frame]
        depth_m = read_array(path, self.camera.size_pix)
        # AirSim writes the rows of a pfm from the top down, against the format's rule.
        depth_m = require_depth(path, depth_m[::-1] if path.suffix == ".pfm" else depth_m)
        far = (depth_m >= SKY_M) | self._classes(frame)[1]
        depth_m = along_axis(depth_m, self.camera) if by_ray else depth_m
        return np.where(far, np.float32(np.inf), depth_m)

    def _classes(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        path = self.files["class"][frame]
        image = read_channels(path, self.camera.size_pix, "RGB").astype(np.int64)
        packed, inverse = np.unique(_packed(image), return_inverse=True)
        if strange := [color for color in packed.tolist() if color not in self.ids]:
            rgb = [strange[0] >> shift & 255 for shift in (16, 8, 0)]
            raise UserError(f"{path}: color {rgb} is not in {PALETTE}; copy AirSim's own")
        theirs = np.array([self.ids[color] for color in packed.tolist()])
        return self.classes.of(path, theirs[inverse].reshape(image.shape[:2]))


@dataclass
class AirSimLayout:
    """Reads the layout ``airsim``.

    Args:
        classes: ids, as simSetSegmentationObjectID set them, as `ClassTable` takes them.
        fov_deg, position_m, pitch_deg: of the camera, which the recording does not say.
    """

    classes: dict
    fov_deg: float
    position_m: list[float]
    pitch_deg: float

    def flights(self, folder: Path) -> list[RecordedFlight]:
        """Returns the recordings of a folder. Raises `UserError` where there is none."""
        return [self._flight(each) for each in folders_with(folder, TABLE)]

    def _flight(self, folder: Path) -> AirSimFlight:
        path = folder / TABLE
        table = read_table(path, ["TimeStamp", *PLACE, *QUAT_XYZW, "ImageFile"], sep="\t")
        poses = poses_from(
            path,
            table[PLACE].to_numpy(np.float64),
            table[QUAT_XYZW].to_numpy(np.float64),
            "north_east_down",
        )

        files = _files(path, table["ImageFile"].tolist())
        size_pix = size_of(files["rgb"][0])
        mount = front_mount(tuple(map(float, self.position_m)), np.deg2rad(self.pitch_deg))
        camera = Camera(pinhole(*size_pix, np.deg2rad(self.fov_deg)), mount, size_pix)

        # Milliseconds.
        time_s = table["TimeStamp"].to_numpy(np.float64) / 1000
        own = folder.name, folder, time_s, poses, camera
        return AirSimFlight(*own, files, ClassTable(self.classes), _palette(folder))


def _files(path: Path, rows: list[str]) -> dict[str, list[Path]]:
    """Returns the images by kind, of names such as ``img_Drone_0_5_1700000000.png``."""
    files: dict[str, list[Path]] = {}
    for row, names in enumerate(rows):
        for name in str(names).split(";"):
            parts = Path(name).stem.split("_")
            kind = KINDS.get(parts[-2]) if len(parts) > 2 else None
            if kind:
                files.setdefault(kind, []).append(path.parent / "images" / name)
        if any(len(of_kind) != row + 1 for of_kind in files.values()):
            raise UserError(f"{path}: row {row} lists not one image of each kind ({names})")

    depth = "depth" in files or "range" in files
    if not (depth and {"rgb", "class"} <= files.keys()):
        raise UserError(
            f"{path}: has images {', '.join(files) or 'of no kind'}; record scene (0), depth (1 or "
            "2, as floats) and segmentation (5)"
        )
    return files


def _palette(folder: Path) -> dict[int, int]:
    """Returns the id of each packed color of ``seg_rgbs.txt``, whose rows are ``3 [112, 105, 191]``
    or, without the id, in the order of the ids."""
    for place in (folder, folder.parent):
        path = place / PALETTE
        if path.is_file():
            rows = [re.findall(r"\d+", line) for line in path.read_text().splitlines()]

            rows = [list(map(int, row)) for row in rows if row]
            if not rows or {len(row) for row in rows} - {3, 4}:
                raise UserError(f"{path}: has rows of other than an id and three numbers")
            ids = [row[0] if len(row) == 4 else n for n, row in enumerate(rows)]
            return {int(_packed(np.array(row[-3:]))): n for n, row in zip(ids, rows)}
    raise UserError(f"{folder}: no {PALETTE} there; AirSim has it, it says which color is which id")


def _packed(rgb: np.ndarray) -> np.ndarray:
    return rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]
