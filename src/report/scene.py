"""A frame for the page's viewer: the image, the true labels, and what each model made of it."""

import base64
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import UNKNOWN
from .overlay import FRUSTUM_SHARE
from .picture import Picture
from .view import Frustum
from .voxels import check_labels, ground_level, render_voxels, view_of

TRUTH = "Ground truth"
IMAGE_PIX, IMAGE_QUALITY = 640, 88
STILL_PIX, STILL_QUALITY = (480, 360), 80
DEFLATE_LEVEL = 9


@dataclass(frozen=True)
class Scene:
    """One frame to look at. ``predictions`` maps the name of a model to its labels, in the order to
    show them. ``frustum``, if given, is drawn, and is the view of "through the camera".

    Raises `UserError` for labels that do not have the grid's shape, and for a model that is named
    like the truth.
    """

    title: str
    grid: VoxelGrid
    image: UInt8[np.ndarray, "h w 3"]
    truth: UInt8[np.ndarray, "X Y Z"]
    predictions: Mapping[str, UInt8[np.ndarray, "X Y Z"]]
    frustum: Frustum | None = None

    def __post_init__(self) -> None:
        if TRUTH in self.predictions:
            raise UserError(f"{self.title}: {TRUTH!r} is no name for a prediction; rename the run")
        for _, labels in self.volumes():
            check_labels(labels, self.grid)

    def volumes(self) -> Iterator[tuple[str, UInt8[np.ndarray, "X Y Z"]]]:
        """Name and labels of each view, the truth first."""
        yield TRUTH, self.truth
        yield from self.predictions.items()

    def known(self) -> dict[str, UInt8[np.ndarray, "X Y Z"]]:
        """The same, with predictions hidden where the truth is unknown: all show the same space."""
        unknown = self.truth == UNKNOWN
        return {name: np.where(unknown, np.uint8(UNKNOWN), v) for name, v in self.volumes()}

    def encoded(self) -> dict:
        """What the viewer reads, as JSON. Lengths in metres, in the occ frame.

        The labels are whole, and not the surface alone: deflated they are no larger than a list of
        surface voxels, and the viewer can then hide a class and show what lies behind it.
        """
        return {
            "title": self.title,
            "lower": list(self.grid.lower_m),
            "voxel": self.grid.voxel_m,
            "shape": list(self.grid.shape),
            "floor": ground_level(self.truth, self.grid),
            "frustum": None if self.frustum is None else self._frustum_points(self.frustum),
            "volumes": [
                {"name": name, "labels": pack_labels(labels)} for name, labels in self.volumes()
            ],
        }

    @property
    def photo(self) -> Picture:
        """The image, no larger than it is shown."""
        image = Image.fromarray(self.image)
        image.thumbnail((IMAGE_PIX, IMAGE_PIX), Image.Resampling.LANCZOS)
        return Picture.jpeg(image, "RGB", IMAGE_QUALITY)

    def _frustum_points(self, frustum: Frustum) -> list[list[float]]:
        """The lens, and the corners of the image before it, clockwise from the top left."""
        depth_m = FRUSTUM_SHARE * (self.grid.upper_m[0] - self.grid.lower_m[0])
        points = [frustum.corners(0.0)[0], *frustum.corners(depth_m)]
        return [[round(float(value), 4) for value in point] for point in points]

    def stills(self) -> Iterator[Picture]:
        """A picture of each view for where there is no viewer, seen from behind and above the UAV,
        of what is `known`."""
        known = self.known()
        view = view_of(list(known.values()), self.grid, STILL_PIX)
        floor_m = ground_level(self.truth, self.grid)
        for name, labels in known.items():
            drawn = render_voxels(labels, self.grid, STILL_PIX, view, self.frustum, floor_m)
            yield Picture.jpeg(Image.fromarray(drawn), name, STILL_QUALITY)


def pack_labels(labels: UInt8[np.ndarray, "X Y Z"]) -> str:
    """Labels, z fastest, as base64 of a zlib stream."""
    packed = zlib.compress(np.ascontiguousarray(labels).tobytes(), DEFLATE_LEVEL)
    return base64.b64encode(packed).decode("ascii")


def unpack_labels(text: str, shape: tuple[int, int, int]) -> UInt8[np.ndarray, "X Y Z"]:
    """The labels that `pack_labels` was given."""
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(shape)
