"""A frame to look at: the image, the ground truth, and the predictions of models."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import UNKNOWN
from .canvas import Pixels
from .view import Frustum, Labels, PlaceM, SizePix
from .voxels import check_labels, ground_level, render_voxels, view_of

TRUTH = "Ground truth"


@dataclass(frozen=True)
class VoxelScene:
    """One frame to look at. ``predictions`` maps the name of a model to its labels, in the order in
    which they are shown. ``frustum``, if given, is drawn.

    Raises `UserError` for labels that do not have the grid's shape, and for a model that is named
    like the ground truth.
    """

    title: str
    grid: VoxelGrid
    image: Pixels
    truth: Labels
    predictions: Mapping[str, Labels]
    frustum: Frustum | None = None

    def __post_init__(self) -> None:
        if TRUTH in self.predictions:
            raise UserError(f"{self.title}: {TRUTH!r} is no name for a prediction; rename the run")
        for labels in self.volumes.values():
            check_labels(labels, self.grid)

    @property
    def volumes(self) -> dict[str, Labels]:
        """The labels of each view by its name, the ground truth first."""
        return {TRUTH: self.truth, **self.predictions}

    def known(self) -> dict[str, Labels]:
        """Returns all `volumes`, unknown where the ground truth is: they show the same space."""
        is_unknown = self.truth == UNKNOWN
        return {
            name: np.where(is_unknown, np.uint8(UNKNOWN), labels)
            for name, labels in self.volumes.items()
        }

    def drawn(self, size_pix: SizePix, view: PlaceM | None = None) -> dict[str, Pixels]:
        """Returns a picture of each `known` volume in 3-D, by its name.

        All have one floor and one point of view, so that they differ in their labels alone. Without
        ``view`` it is the one that has all their occupied voxels in the picture.
        """
        known, grid = self.known(), self.grid
        view = view or view_of(list(known.values()), grid, size_pix)
        floor_m = ground_level(self.truth, grid)
        return {
            name: render_voxels(labels, grid, size_pix, view, self.frustum, floor_m)
            for name, labels in known.items()
        }
