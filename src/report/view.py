"""Cameras of the figures: the observer's behind the UAV, and the UAV's own."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ..data.clip import Clip
from ..geometry import camera_from_occ, front_mount, inverse, pinhole, project, transform, unproject

# How far the observer is pitched down, and how wide its lens is. It is never rolled.
PITCH_RAD, HFOV_RAD = math.radians(32), math.radians(36)
# Room around what the observer sees, as a share of the picture.
MARGIN = 0.02
# Depth of a drawn frustum, as a share of the grid's length.
FRUSTUM_SHARE = 0.16

# A place in the occ frame; width and height of a picture; class ids of voxels.
PlaceM = tuple[float, float, float]
SizePix = tuple[int, int]
Labels = UInt8[np.ndarray, "X Y Z"]


@dataclass(frozen=True)
class Frustum:
    """A camera, such as the UAV's own: transform, intrinsics, and its image's width and height."""

    camera_from_occ: Float[Tensor, "4 4"]
    pix_from_camera: Float[Tensor, "3 3"]
    size_pix: SizePix

    @classmethod
    def of(cls, clip: Clip, frame: int) -> "Frustum":
        """The camera of a frame of a clip, by the chain that the model projects with."""
        meta = clip.meta
        chain = camera_from_occ(clip.world_from_body[frame], meta.body_from_camera)
        return cls(chain, meta.pix_from_camera, (meta.width, meta.height))

    @classmethod
    def observer(cls, place_m: PlaceM, size_pix: SizePix) -> "Frustum":
        """The observer's camera at a place, in float64."""
        view_from_occ = inverse(front_mount(place_m, PITCH_RAD))
        return cls(view_from_occ, pinhole(*size_pix, HFOV_RAD), size_pix)

    def project(
        self, points_occ: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n"]]:
        """Location in the image and z-depth in metres of points in the occ frame."""
        return project(points_occ, self.camera_from_occ, self.pix_from_camera)

    def corners(self, depth_m: float) -> Float[Tensor, "4 3"]:
        """The image's corners at a z-depth, in the occ frame, clockwise from the top left."""
        width, height = self.size_pix
        pix = torch.tensor([[0, 0], [width, 0], [width, height], [0, height]], dtype=torch.float64)
        depths_m = torch.full((4,), depth_m, dtype=torch.float64)
        corners_camera = unproject(pix, depths_m, self.pix_from_camera.double())
        return transform(inverse(self.camera_from_occ.double()), corners_camera)

    def outline(self, depth_m: float) -> list[list[float]]:
        """A line in the occ frame along all edges of the pyramid between the lens and the image at
        a z-depth."""
        points = [*self.corners(depth_m).tolist(), self.corners(0.0)[0].tolist()]
        return [points[n] for n in (0, 1, 2, 3, 0, 4, 1, 2, 4, 3)]


def place_behind(points_occ: Float[Tensor, "n 3"], aspect: float) -> PlaceM:
    """The observer's place behind and above the UAV, as near as lets all the points into the
    picture; ``aspect`` is its width over its height.

    The points bound the place along each side of the lens; where left meets right, and top meets
    bottom, is the nearest.
    """
    occ_from_view = front_mount((0.0, 0.0, 0.0), PITCH_RAD)
    x, y, z = transform(inverse(occ_from_view), points_occ.double()).unbind(-1)

    # Through each side of the lens runs a plane; every point must lie inside all four.
    slope_x = math.tan(HFOV_RAD / 2) * (1 - 2 * MARGIN)
    slope_y = slope_x / aspect
    right, left = (x - slope_x * z).max(), (x + slope_x * z).min()
    bottom, top = (y - slope_y * z).max(), (y + slope_y * z).min()

    depth = torch.minimum((left - right) / (2 * slope_x), (top - bottom) / (2 * slope_y))
    place = torch.stack([(left + right) / 2, (top + bottom) / 2, depth])
    return tuple((occ_from_view[:3, :3] @ place).tolist())
