"""Occ3D's files: one ``labels.npz`` a frame, with ``semantics`` and two masks."""

from pathlib import Path
from typing import ClassVar

import numpy as np

from ..data.files import BROKEN, array_of, fault_of, files_below, open_npz
from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import CLASSES
from .label_format import Ids, Marks, Sample, Shape, WrittenFormat

LABELS = "labels.npz"


class Occ3D(WrittenFormat):
    """``<scene>/<token>/labels.npz``; written with our own ids, of which free is the last one.

    ``mask_lidar`` marks every voxel with a label, ``mask_camera`` those that the camera sees now.
    """

    name = "occ3d"
    pattern = f"<scene>/<token>/{LABELS}"
    masks = ("mask_camera", "mask_lidar")
    visible = "mask_camera"
    ids: ClassVar = {name: number for number, name in enumerate(CLASSES)}

    def place(self, scene: str, token: str, predicted: bool) -> str:
        return f"{scene}/{token}/{LABELS}"

    def find(self, root: Path, predicted: bool) -> dict[Sample, Path]:
        return {
            (path.parent.parent.relative_to(root).as_posix(), path.parent.name): path
            for path in files_below(root, LABELS)
            if path.parent != root
        }

    def read(self, path: Path, grid: VoxelGrid) -> Ids:
        array = self._array(path, "semantics", grid.shape)
        if fault := fault_of(array):
            raise UserError(f"{path}: semantics {fault}")
        return array.astype(np.int64)

    def read_mask(self, path: Path, name: str, shape: Shape) -> Marks:
        return self._array(path, name, shape).astype(bool)

    def write(self, path: Path, ids: Ids, known: Marks, visible: Marks) -> None:
        masks = {"mask_lidar": known, "mask_camera": known & visible}
        np.savez_compressed(path, semantics=ids.astype(np.uint8), **masks)

    def _array(self, path: Path, name: str, shape: Shape) -> np.ndarray:
        try:
            with open_npz(path) as archive:
                array = array_of(archive, name)
        except BROKEN as error:
            raise UserError(f"{path}: {name} cannot be read ({error})") from error
        if array.shape != shape:
            hint = "state layout.grid as it is"
            if array.shape == shape[::-1]:
                hint = "the axes are z, y, x: transpose them to x, y, z"
            raise UserError(
                f"{path}: {name} are {list(array.shape)}, and the grid is {list(shape)}; {hint}"
            )
        return array
