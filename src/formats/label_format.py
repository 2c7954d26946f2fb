"""What a label format is: where its files lie, what they hold, and how ours are written as them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Integer

from ..geometry import VoxelGrid

Sample = tuple[str, str]
Shape = tuple[int, int, int]
Ids = Integer[np.ndarray, "X Y Z"]
Marks = Bool[np.ndarray, "X Y Z"]


class LabelFormat(ABC):
    """A tool's way to keep labels, a frame a file. Arrays are [X, Y, Z]: forward, left, up.

    ``pattern`` shows in messages how files are named.
    """

    name: ClassVar[str]
    pattern: ClassVar[str]
    masks: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def find(self, root: Path, predicted: bool) -> dict[Sample, Path]:
        """Returns the files of labels, or of predictions, below a folder, by scene and token."""

    @abstractmethod
    def read(self, path: Path, grid: VoxelGrid) -> Ids:
        """Returns the ids of a file. Raises `UserError` where it does not hold such a grid."""


class WrittenFormat(LabelFormat):
    """A format in which ours are written, too. It can tell labelled and visible voxels.

    ``masks`` are those that can be read, ``visible`` is the one of what the camera sees, and
    ``ids`` are those that our classes get.
    """

    visible: ClassVar[str]
    ids: ClassVar[Mapping[str, int]]

    def scene_of(self, clip: str, number: int) -> str:
        """Returns what a clip is called there; ``number`` counts the clips of the dataset."""
        return clip

    @abstractmethod
    def place(self, scene: str, token: str, predicted: bool) -> str:
        """Returns the path of a frame's file, relative to the folder."""

    @abstractmethod
    def read_mask(self, path: Path, name: str, shape: Shape) -> Marks:
        """Returns one of the ``masks``. Raises `UserError` as `read` does."""

    @abstractmethod
    def write(self, path: Path, ids: Ids, known: Marks, visible: Marks) -> None:
        """Writes a frame: its ids, which voxels have a label, and which the camera sees."""
