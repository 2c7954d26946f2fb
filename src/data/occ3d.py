"""Labels in Occ3D's layout: one ``labels.npz`` a frame, with ``semantics`` and two masks.

Occ3D stores neither our classes nor its grid nor how fast the vehicle was; all three must be
stated.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import CLASSES, UNKNOWN
from .files import BROKEN, array_of, fault_of, files_below, open_npz
from .predictions import Inventory

LABELS = "labels.npz"
MASKS = ("mask_camera", "mask_lidar")
Sample = tuple[str, str]


class Occ3DFolder:
    """Frames ``<scene>/<token>/labels.npz`` as labels of our classes.

    Args:
        root: the folder, such as Occ3D's ``gts``.
        class_map: our class, by name, of every class of the folder, in the order of its ids.
        grid: where the voxels lie, relative to the vehicle.

    Raises `UserError` for a folder without frames, and for a class that is none of ours.
    """

    def __init__(self, root: Path, class_map: Sequence[str], grid: VoxelGrid) -> None:
        self.root, self.name, self.grid = root, root.name, grid
        if strange := [name for name in class_map if name not in (*CLASSES, "unknown")]:
            raise UserError(
                f"layout.class_map: {strange[0]!r} is no class; there are {', '.join(CLASSES)}, "
                "and unknown"
            )

        ids = [UNKNOWN if name == "unknown" else CLASSES.index(name) for name in class_map]
        # One look-up for every value that a uint8 can have.
        self._map = np.full(256, UNKNOWN, dtype=np.uint8)
        self._map[: len(ids)] = ids
        self._known = len(ids)

        self.samples: list[Sample] = [
            (path.parent.parent.relative_to(self.root).as_posix(), path.parent.name)
            for path in files_below(self.root, LABELS)
        ]
        if not self.samples:
            raise UserError(f"{self.root}: holds no <scene>/<token>/{LABELS}")

    def labels(self, scene: str, token: str) -> UInt8[Tensor, "X Y Z"]:
        """Returns a frame in our classes.

        Raises `UserError` for a file that cannot be read or does not fit the grid or the class map.
        """
        path = self.root / scene / token / LABELS
        stored = self._read(scene, token, "semantics")
        if stored.shape != self.grid.shape:
            raise UserError(
                f"{path}: semantics are {list(stored.shape)}, and the grid is "
                f"{list(self.grid.shape)}; {_hint(stored.shape, self.grid.shape)}"
            )

        # 255 may mark voxels without a label there, too.
        strange = stored[((stored < 0) | (stored >= self._known)) & (stored != UNKNOWN)]
        if strange.size:
            raise UserError(
                f"{path}: class {strange.flat[0]:g} is not in layout.class_map, which has "
                f"{self._known}; give it the name of one of our classes for each of theirs"
            )
        return torch.from_numpy(self._map[stored.astype(np.uint8)])

    def mask(self, scene: str, token: str, name: str) -> Tensor:
        """Returns ``mask_camera`` or ``mask_lidar`` as bool [X, Y, Z]."""
        return torch.from_numpy(self._read(scene, token, name).astype(bool))

    def inventory(self, samples: Sequence[Sample]) -> Inventory:
        """Compares what is there with the frames that are asked for, and opens every array."""
        wanted, present = set(samples), set(self.samples)
        return Inventory(
            missing=["/".join(sample) for sample in sorted(wanted - present)],
            extra=["/".join(sample) for sample in sorted(present - wanted)],
            corrupt=[
                problem for one in sorted(wanted & present) if (problem := self.problem_of(*one))
            ],
        )

    def problem_of(self, scene: str, token: str) -> str:
        """Says with the file's name why a frame is no prediction to score; empty if it is one."""
        try:
            unknown = int((self.labels(scene, token) == UNKNOWN).sum())
        except UserError as error:
            return str(error)
        path = self.root / scene / token / LABELS
        return f"{path}: {unknown} voxels are unknown, which is no prediction" if unknown else ""

    def _read(self, scene: str, token: str, name: str) -> np.ndarray:
        path = self.root / scene / token / LABELS
        try:
            with open_npz(path) as archive:
                array = array_of(archive, name)
        except BROKEN as error:
            raise UserError(f"{path}: {name} cannot be read ({error})") from error
        if name not in MASKS and (fault := fault_of(array)):
            raise UserError(f"{path}: {name} {fault}")
        return array


def _hint(shape: tuple[int, ...], wanted: tuple[int, ...]) -> str:
    if shape == wanted[::-1]:
        return "the axes are z, y, x: transpose them to x, y, z"
    return "state layout.grid as it is"
