"""SemanticKITTI's files: a flat ``.label`` a frame, and masks of a bit a voxel beside it."""

import os
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..errors import UserError
from ..geometry import VoxelGrid
from .label_format import Ids, Marks, Sample, Shape, WrittenFormat


class SemanticKitti(WrittenFormat):
    """``sequences/<nn>/voxels/<frame>.label``, uint16, and ``.invalid`` and ``.occluded``.

    Predictions lie in ``predictions`` instead of ``voxels``. Ours are written with ids of theirs;
    an unknown voxel is empty and invalid, as there.
    """

    name = "semantickitti"
    pattern = "sequences/<nn>/voxels/<frame>.label (predictions: predictions/<frame>.label)"
    masks = ("valid", "visible")
    visible = "visible"
    ids: ClassVar = {
        **{"building": 50, "ground": 40, "vegetation": 70, "thin_structure": 80},
        **{"large_vehicle": 18, "car": 10, "vru": 30, "general": 99, "free": 0},
    }
    dtype = np.dtype("<u2")
    roles = ("voxels", "predictions")

    def scene_of(self, clip: str, number: int) -> str:
        return f"sequences/{number:02d}"

    def place(self, scene: str, token: str, predicted: bool) -> str:
        return f"{scene}/{self.roles[predicted]}/{token}.label"

    def find(self, root: Path, predicted: bool) -> dict[Sample, Path]:
        role, found = self.roles[predicted], {}
        for folder, _, files in os.walk(root, followlinks=True):
            parts = Path(folder).relative_to(root).parts
            if role in parts:
                scene = "/".join(parts[: parts.index(role)])
                names = [name for name in files if name.endswith(".label")]
                found |= {(scene, name[: -len(".label")]): Path(folder, name) for name in names}
        return dict(sorted(found.items()))

    def read(self, path: Path, grid: VoxelGrid) -> Ids:
        shape = grid.shape
        return self.from_theirs(self._flat(path, self.dtype, int(np.prod(shape)), shape), shape)

    def read_mask(self, path: Path, name: str, shape: Shape) -> Marks:
        marked = ~self._bits(path.with_suffix(".invalid"), shape)
        if name == "visible":
            marked &= ~self._bits(path.with_suffix(".occluded"), shape)
        return marked

    def write(self, path: Path, ids: Ids, known: Marks, visible: Marks) -> None:
        path.write_bytes(self.to_theirs(ids).astype(self.dtype).tobytes())
        for suffix, bits in ((".invalid", ~known), (".occluded", ~visible)):
            # The first voxel is the highest bit of the first byte.
            path.with_suffix(suffix).write_bytes(np.packbits(self.to_theirs(bits)).tobytes())

    def to_theirs(self, array: np.ndarray) -> np.ndarray:
        """Returns an array [X, Y, Z] with the axes of the files."""
        return array

    def from_theirs(self, flat: np.ndarray, shape: Shape) -> np.ndarray:
        """Returns an array [X, Y, Z] of what a file holds."""
        return flat.reshape(shape)

    def _bits(self, path: Path, shape: Shape) -> Marks:
        voxels = int(np.prod(shape))
        packed = self._flat(path, np.dtype(np.uint8), -(-voxels // 8), shape)
        return self.from_theirs(np.unpackbits(packed)[:voxels].astype(bool), shape)

    def _flat(self, path: Path, dtype: np.dtype, count: int, shape: Shape) -> np.ndarray:
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UserError(f"{path}: cannot be read ({error.strerror or error})") from error
        if len(content) != count * dtype.itemsize:
            raise UserError(
                f"{path}: has {len(content)} bytes, and a grid of {list(shape)} takes "
                f"{count * dtype.itemsize}; state layout.grid as it is, or write the file again"
            )
        return np.frombuffer(content, dtype)
