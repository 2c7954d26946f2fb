"""A folder of labels or predictions in another tool's format, read as labels of our classes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from ..data.predictions import Inventory
from ..errors import UserError, closest
from ..geometry import VoxelGrid
from ..ontology import CLASSES, UNKNOWN
from .label_format import LabelFormat, Sample

# In the table of ids: one that the class map does not have.
NO_CLASS = 254


class LabelFolder:
    """Frames of a folder, by scene and token.

    Args:
        of: the format of its files.
        root: the folder.
        class_map: our class, by name, of every id there: by id, or in the order of the ids.
        grid: where the voxels lie, in the frame ``occ``.
        predicted: whether these are predictions, which some formats keep in another place.

    Raises `UserError` for a folder without frames, and for a class that is none of ours.
    """

    def __init__(
        self,
        of: LabelFormat,
        root: Path,
        class_map: Sequence[str] | Mapping[int, str],
        grid: VoxelGrid,
        predicted: bool = False,
    ) -> None:
        self.root, self.name, self.grid, self._format = root, root.name, grid, of
        by_id = dict(class_map if isinstance(class_map, Mapping) else enumerate(class_map))
        self._table, self._classes = _table_of(by_id), len(by_id)

        self._paths = of.find(root, predicted)
        self.samples: list[Sample] = list(self._paths)
        if not self.samples:
            raise UserError(f"{root}: holds no {of.pattern}")

    def labels(self, scene: str, token: str) -> UInt8[Tensor, "X Y Z"]:
        """Returns a frame in our classes.

        Raises `UserError` for a file that cannot be read or does not fit the grid or the class map.
        """
        path = self._paths[scene, token]
        stored = self._format.read(path, self.grid)
        last = len(self._table) - 1
        ours = self._table[np.where((stored < 0) | (stored > last), last, stored)]

        if (strange := stored[ours == NO_CLASS]).size:
            raise UserError(
                f"{path}: class {strange[0]} is not in layout.class_map, which has "
                f"{self._classes}; give it the name of one of our classes for each of theirs"
            )
        return torch.from_numpy(ours)

    def mask(self, scene: str, token: str, name: str) -> Bool[Tensor, "X Y Z"]:
        """Returns one of the masks of the format. Raises `UserError` as `labels` does."""
        marked = self._format.read_mask(self._paths[scene, token], name, self.grid.shape)
        return torch.from_numpy(np.ascontiguousarray(marked))

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
        if (scene, token) not in self._paths:
            return f"{self.root}: has no {scene}/{token}"
        try:
            unknown = int((self.labels(scene, token) == UNKNOWN).sum())
        except UserError as error:
            return str(error)
        path = self._paths[scene, token]
        return f"{path}: {unknown} voxels are unknown, which is no prediction" if unknown else ""


def _table_of(by_id: Mapping[int, str]) -> UInt8[np.ndarray, " ids"]:
    """Returns our class of every id; the last entry stands for all ids above the others."""
    if strange := [theirs for theirs in by_id if type(theirs) is not int or theirs < 0]:
        raise UserError(f"layout.class_map: {strange[0]!r} is no id; give 0 or more")

    table = np.full(max([UNKNOWN, *by_id]) + 2, NO_CLASS, np.uint8)
    # 255 may mark voxels without a label there, too.
    table[UNKNOWN] = UNKNOWN

    known = {**{name: number for number, name in enumerate(CLASSES)}, "unknown": UNKNOWN}
    for theirs, name in by_id.items():
        if name not in known:
            raise UserError(
                f"layout.class_map: {name!r} is no class{closest(str(name), known)} there are "
                f"{', '.join(CLASSES)}, and unknown"
            )
        table[theirs] = known[name]
    return table
