"""A frame for the report's page: the image, the ground truth, and the predictions of models."""

import base64
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import FREE, UNKNOWN
from .overlay import FRUSTUM_SHARE
from .picture import Picture
from .view import Frustum, Viewpoint
from .voxel_mesh import CLASS_PALETTE, voxel_meshes
from .voxels import check_labels, ground_level, render_voxels, view_of

TRUTH = "Ground truth"
IMAGE_PIX, IMAGE_QUALITY = 640, 88
STILL_PIX, STILL_QUALITY = (480, 360), 80

# Hues that no class has, and that color-blind readers tell apart.
ERROR_PALETTE = {
    "right": (160, 170, 182),
    "other class": (255, 146, 40),
    "false alarm": (70, 184, 255),
    "missed": (226, 38, 120),
}

# Legible on white and on black: the page has both.
FRUSTUM_COLOR, UAV_COLOR = "#eb5e14", "#7b8794"
AXIS = {"color": "#7b8794", "gridcolor": "#9aa4b0", "dtick": 10, "showspikes": False}

Labels = UInt8[np.ndarray, "X Y Z"]


@dataclass(frozen=True)
class VoxelScene:
    """One frame to look at. ``predictions`` maps the name of a model to its labels, in the order in
    which they are shown. ``frustum``, if given, is drawn.

    Raises `UserError` for labels that do not have the grid's shape, and for a model that is named
    like the ground truth.
    """

    title: str
    grid: VoxelGrid
    image: UInt8[np.ndarray, "h w 3"]
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

    def packed(self) -> str:
        """Returns `encoded` as base64 of deflated JSON, a fifth of its size."""
        text = json.dumps(self.encoded(), separators=(",", ":"))
        return base64.b64encode(zlib.compress(text.encode(), level=9)).decode("ascii")

    def encoded(self) -> dict:
        """Returns the JSON that the page's viewer reads. Lengths are in metres of the occ frame."""
        occupied = [labels < FREE for labels in self.volumes.values()]
        layers = np.flatnonzero(np.any(occupied, axis=(0, 1, 2)))
        edges = self.grid.lower_m[2] + self.grid.voxel_m * np.append(layers, layers + 1)
        # Above and below all voxels and the UAV, at height 0, there is nothing to look at.
        heights_m = (float(edges.min(initial=0)), float(edges.max(initial=0)))
        ends_m = list(zip(self.grid.lower_m, self.grid.upper_m))
        ends_m[2] = heights_m

        return {
            "shape": self.grid.shape,
            "lower": self.grid.lower_m,
            "voxel": self.grid.voxel_m,
            "names": [*CLASS_PALETTE, "free", "unknown"],
            "share_from_occ": self._share_from_occ().tolist(),
            "layout": _layout(ends_m),
            "lines": self._lines(heights_m[0]),
            "views": [self._view(name, known) for name, known in self.known().items()],
        }

    def _view(self, name: str, known: Labels) -> dict:
        """Returns the meshes of a view by what the reader can choose to look at.

        They are the classes where the ground truth is known, the errors there, and the classes
        everywhere. ``labels`` are one digit a voxel, z fastest, 9 for unknown.
        """
        labels = self.volumes[name]
        digits = np.minimum(labels, FREE + 1) + ord("0")
        view = {"name": name, "labels": digits.tobytes().decode("ascii"), "counts": ""}
        view["meshes"] = {"classes": voxel_meshes(known, self.grid, CLASS_PALETTE)}
        if name == TRUTH:
            return view

        errors = errors_of(self.truth, labels)
        counts = np.bincount(errors.ravel(), minlength=len(ERROR_PALETTE))
        view["counts"] = " · ".join(f"{key} {n:,}" for key, n in zip(ERROR_PALETTE, counts))
        view["meshes"]["errors"] = voxel_meshes(errors, self.grid, ERROR_PALETTE)
        view["meshes"]["everywhere"] = voxel_meshes(labels, self.grid, CLASS_PALETTE)
        return view

    def _share_from_occ(self) -> Float[np.ndarray, "3 4"]:
        """Returns the projection from metres to shares of the image's width and height.

        Without a camera it is zero, so that every point has depth 0: none is in the image.
        """
        if self.frustum is None:
            return np.zeros((3, 4))

        pix_from_camera = self.frustum.pix_from_camera.double().numpy()
        camera_from_occ = self.frustum.camera_from_occ.double().numpy()[:3]
        return pix_from_camera @ camera_from_occ / [[side] for side in (*self.frustum.size_pix, 1)]

    def _lines(self, floor_m: float) -> list[dict]:
        """Returns the UAV's plumb line and, if there is a camera, the edges of its frustum."""
        lines = [_line(UAV_COLOR, [(0, 0, floor_m), (0, 0, 0)])]
        if self.frustum is not None:
            lens = self.frustum.corners(0.0).tolist()[0]
            depth_m = FRUSTUM_SHARE * (self.grid.upper_m[0] - self.grid.lower_m[0])
            corners = self.frustum.corners(depth_m).tolist()
            spokes = [point for corner in corners for point in (lens, corner)]
            lines.append(_line(FRUSTUM_COLOR, [*corners, *spokes, corners[0]]))

        return lines

    def stills(self) -> Iterator[Picture]:
        """Yields the image, and a picture of each `known` view from behind and above the UAV.

        They stand on paper, and wherever the browser cannot draw meshes.
        """
        image = Image.fromarray(self.image)
        image.thumbnail((IMAGE_PIX, IMAGE_PIX), Image.Resampling.LANCZOS)
        yield Picture.jpeg(image, "RGB", IMAGE_QUALITY)

        for name, drawn in self.drawn(STILL_PIX).items():
            yield Picture.jpeg(Image.fromarray(drawn), name, STILL_QUALITY)

    def drawn(
        self, size_pix: tuple[int, int], view: Viewpoint | None = None
    ) -> dict[str, UInt8[np.ndarray, "h w 3"]]:
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


def errors_of(truth: Labels, preds: Labels) -> Labels:
    """Returns the index in `ERROR_PALETTE` of each voxel that either holds occupied.

    Voxels that both hold free, or that the ground truth does not know, have the unknown label.
    """
    in_truth, in_preds = truth < FREE, preds < FREE
    cases = [truth == UNKNOWN, in_truth & (truth == preds), in_truth & in_preds, in_preds, in_truth]
    return np.select(cases, [UNKNOWN, 0, 1, 2, 3], default=UNKNOWN).astype(np.uint8)


def _line(color: str, points_m: Sequence[Sequence[float]]) -> dict:
    x, y, z = zip(*points_m)
    line = {"x": x, "y": y, "z": z, "line": {"color": color, "width": 4}}
    return {"type": "scatter3d", "mode": "lines", "hoverinfo": "skip", **line}


def _layout(ends_m: Sequence[tuple[float, float]]) -> dict:
    """Returns what all views share: with equal ranges, one camera shows one place in each."""
    sides_m = [high - low for low, high in ends_m]
    # The longer side of the ground is 1.5 units of plotly's cameras in every scene.
    ratio = [1.5 * side / max(sides_m[:2]) for side in sides_m]
    titles = ("ahead (m)", "left (m)", "up (m)")
    axes = {
        f"{name}axis": {"title": {"text": title}, "range": ends, **AXIS}
        for name, title, ends in zip("xyz", titles, ends_m)
    }
    scene = {**axes, "aspectratio": dict(zip("xyz", ratio)), "dragmode": "turntable"}
    margin = dict.fromkeys("lrtb", 0)
    return {"paper_bgcolor": "#0000", "margin": margin, "showlegend": False, "scene": scene}
