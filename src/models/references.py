"""Height references of the pillars, and where a camera sees them (Eq. 5 and App. A.2)."""

from typing import Literal, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid, camera_from_occ, in_image, project

Projection = Literal["attitude", "level"]


class References(NamedTuple):
    """Reference points of P pillars, J a pillar, in one image each.

    ``pix`` [B, P, J, 2] are pixels of the full image, ``depth_m`` [B, P, J] z-depths, ``valid``
    [B, P, J] the paper's set J_p: before the camera and inside the image.
    """

    pix: Float[Tensor, "b p j 2"]
    depth_m: Float[Tensor, "b p j"]
    valid: Bool[Tensor, "b p j"]


class PillarReferences(nn.Module):
    """Projects ``num_heights`` points a pillar, at the z-centres of equal slices of the grid.

    ``projection="attitude"`` is the paper's chain. ``"level"`` is the baseline's: the UAV is taken
    to be level, and the camera's mount is kept.
    """

    def __init__(self, grid: VoxelGrid, num_heights: int, projection: Projection) -> None:
        super().__init__()
        if projection not in ("attitude", "level"):
            raise UserError(f"projection: {projection!r} is neither 'attitude' nor 'level'")
        self.projection = projection
        slice_m = (grid.upper_m[2] - grid.lower_m[2]) / num_heights
        z_m = grid.lower_m[2] + (torch.arange(num_heights) + 0.5) * slice_m
        points = grid.centers()[:, :, :1].repeat(1, 1, num_heights, 1)
        points[..., 2] = z_m
        self.register_buffer("points_occ", points.flatten(0, 1), persistent=False)

    def forward(
        self,
        occ_from_body: Float[Tensor, "b 4 4"],
        body_from_camera: Float[Tensor, "b 4 4"],
        pix_from_camera: Float[Tensor, "b 3 3"],
        image_size: tuple[int, int],
    ) -> References:
        """``image_size`` is width and height in pixels."""
        if self.projection == "level":
            occ_from_body = torch.eye(4).to(occ_from_body).expand_as(occ_from_body)
        # Autocast would round pixel coordinates to 8 bits.
        with torch.autocast(occ_from_body.device.type, enabled=False):
            pix, depth_m = project(
                self.points_occ.flatten(0, 1),
                camera_from_occ(occ_from_body.float(), body_from_camera.float()),
                pix_from_camera.float(),
            )
        valid = in_image(pix, depth_m, *image_size)
        pillars = self.points_occ.shape[:2]
        return References(*(x.unflatten(1, pillars) for x in (pix, depth_m, valid)))
