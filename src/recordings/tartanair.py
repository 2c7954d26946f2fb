"""Layout ``tartanair``: trajectories of TartanAir V2 and TartanGround, in which nothing moves.

``<trajectory>/image_lcam_front/``, ``depth_...``, ``seg_...`` and ``pose_lcam_front.txt``; of the
other five cameras the depth and classes are fused where they are there.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8

from ..data.pictures import files_of, read_channels, read_ids, read_rgb, require_depth, size_of
from ..errors import UserError, reason_of
from ..geometry import front_mount, pinhole
from ..limits import require_finite
from ..sim.annotation import FrontView
from ..sim.sensors import Scan
from .classes import ClassTable, names_of
from .flight import Camera, RecordedFlight, poses_from, require_frames
from .plain import folders_with

FRONT, OTHERS = "lcam_front", ("back", "left", "right", "top", "bottom")
# Of every camera, across.
HFOV_RAD = np.pi / 2
# Every n-th pixel of the cameras that do not look ahead.
STRIDE = 4


@dataclass
class TartanAirFlight(RecordedFlight):
    """A trajectory. ``files`` are its images, by kind and camera."""

    files: dict[tuple[str, str], list[Path]]
    classes: ClassTable
    poses: dict[str, torch.Tensor]

    def image(self, frame: int) -> UInt8[np.ndarray, "h w 3"]:
        return read_rgb(self.files["image", FRONT][frame], self.camera.size_pix)

    def depth_m(self, frame: int) -> Float[np.ndarray, "h w"]:
        return self._depth_m(FRONT, frame)

    def class_id(self, frame: int) -> UInt8[np.ndarray, "h w"]:
        return self._classes(FRONT, frame)[0]

    def scans(self, frame: int) -> list[Scan]:
        mount = self.camera.body_from_camera, self.camera.pix_from_camera
        nobody = np.zeros(self.camera.size_pix[::-1], dtype=np.int32)

        return [
            FrontView(
                self.poses[camera][frame],
                *mount,
                self._depth_m(camera, frame),
                self._classes(camera, frame)[0],
                nobody,
            ).rays(STRIDE, np.inf)
            for camera in self.poses
        ]

    def _depth_m(self, camera: str, frame: int) -> Float[np.ndarray, "h w"]:
        path = self.files["depth", camera][frame]
        rgba = read_channels(path, self.camera.size_pix, "RGBA")
        # OpenCV wrote them: a float's bytes are blue, green, red, alpha.
        bytes_of = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]])
        depth_m = require_depth(path, bytes_of.view("<f4")[..., 0])
        return np.where(self._classes(camera, frame)[1], np.float32(np.inf), depth_m)

    def _classes(self, camera: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
        path = self.files["seg", camera][frame]
        return self.classes.of(path, read_ids(path, self.camera.size_pix))


@dataclass
class TartanAirLayout:
    """Reads the layout ``tartanair``.

    Args:
        classes: words in the names of an environment's classes, as `ClassTable` takes them.
        rate_hz: frames a second; the files do not say it.
    """

    classes: dict
    rate_hz: float
    unmatched: list[str] = field(init=False, default_factory=list)

    static = True

    def __post_init__(self) -> None:
        require_finite("layout.rate_hz", self.rate_hz)

    def flights(self, folder: Path) -> list[RecordedFlight]:
        """Returns the trajectories of a folder. Raises `UserError` where there is none."""
        return [self._flight(each) for each in folders_with(folder, f"pose_{FRONT}.txt")]

    def _flight(self, folder: Path) -> TartanAirFlight:
        front = self._poses(folder, FRONT)
        others = [f"lcam_{name}" for name in OTHERS if (folder / f"depth_lcam_{name}").is_dir()]
        poses = {camera: self._poses(folder, camera) for camera in others}
        files = {
            (kind, camera): files_of(folder / f"{kind}_{camera}", ".png")
            for camera in (FRONT, *others)
            for kind in (("image", "depth", "seg") if camera == FRONT else ("depth", "seg"))
        }
        require_frames(folder / f"pose_{FRONT}.txt", files.values(), len(front))

        table = ClassTable(self.classes, names_of(folder))
        self.unmatched += [name for name in table.unmatched if name not in self.unmatched]
        size_pix = size_of(files["image", FRONT][0])
        camera = Camera(pinhole(*size_pix, HFOV_RAD), front_mount((0.0, 0.0, 0.0)), size_pix)
        time_s = np.arange(len(front)) / self.rate_hz
        return TartanAirFlight(folder.name, folder, time_s, front, camera, files, table, poses)

    def _poses(self, folder: Path, camera: str) -> torch.Tensor:
        path = folder / f"pose_{camera}.txt"
        try:
            values = np.loadtxt(path, dtype=np.float64, ndmin=2)
        except (OSError, ValueError) as error:
            raise UserError(f"{path}: cannot be read ({reason_of(error)})") from error
        if values.ndim != 2 or values.shape[1] != 7 or not len(values):
            raise UserError(f"{path}: has rows of {values.shape[-1]}, not x y z qx qy qz qw")
        return poses_from(path, values[:, :3], values[:, 3:], "north_east_down")
