"""Height references of the pillars, and where a camera sees them (Eq. 5 and App. A.2)."""

import math
from typing import Literal, NamedTuple, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid, camera_from_occ, in_image, pixel_centers, project
from ..limits import require_choice
from .backbone import STRIDES
from .ground import occ_from_ground

Projection = Literal["attitude", "level"]


class References(NamedTuple):
    """Reference points of P pillars, J a pillar, in one image each.

    ``pix`` [B, P, J, 2] are pixels of the full image, ``depth_m`` [B, P, J] z-depths, ``valid``
    [B, P, J] the paper's set J_p: before the camera and inside the image. ``in_view`` [R] lists the
    valid ones by their place in the flattened [B, P, J], in order; where it has room for more, it
    is padded with B * P * J. ``camera_from_volume`` and ``pix_from_camera`` projected them.
    """

    pix: Float[Tensor, "b p j 2"]
    depth_m: Float[Tensor, "b p j"]
    valid: Bool[Tensor, "b p j"]
    in_view: Int[Tensor, "r"]
    camera_from_volume: Float[Tensor, "b 4 4"]
    pix_from_camera: Float[Tensor, "b 3 3"]

    def listed(self) -> "ListedReferences":
        """Those of ``in_view``, padding included: it is taken to lie at pixel (0, 0)."""
        pillars, heights = self.valid.shape[1:]
        place = self.in_view.clamp(max=self.valid.numel() - 1)
        # What is padded may lie anywhere, even nowhere.
        is_padding = self.in_view[:, None] != place[:, None]
        pix = self.pix.flatten(0, 2)[place].masked_fill(is_padding, 0.0)
        pillar = place // heights
        return ListedReferences(pix, pillar // pillars, pillar % pillars, place % heights)


class ListedReferences(NamedTuple):
    """R references one by one: pixel of the full image, frame, pillar of the frame, and height."""

    pix: Float[Tensor, "r 2"]
    frame: Int[Tensor, "r"]
    pillar: Int[Tensor, "r"]
    height: Int[Tensor, "r"]

    def pix_of_levels(self) -> Float[Tensor, "2 levels r"]:
        """x and y in each level's own pixels, with integers at their centers."""
        return torch.stack([self.pix.T / stride - 0.5 for stride in STRIDES], dim=1)


class PillarReferences(nn.Module):
    """Projects ``num_heights`` points a pillar, at the z-centers of equal slices of the grid.

    The grid lies in the occ frame or, for a UAV whose height is given, in the ground frame.
    ``projection="attitude"`` is the paper's chain. ``"level"`` is the baseline's: the UAV is taken
    to be level, and the camera's mount is kept.

    ``capacity`` is the share of a frame's references that ``in_view`` has room for: shapes are then
    the same for every frame, which compiled graphs need. ``None`` lists exactly those in view.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        num_heights: int,
        projection: Projection,
        capacity: float | None = None,
    ) -> None:
        super().__init__()
        require_choice("model.encoder.projection", projection, get_args(Projection))
        if capacity is not None and not 0 < capacity <= 1:
            raise UserError(
                f"model.encoder.capacity: {capacity} is no share; give null, or more than 0, up "
                "to 1"
            )

        self.projection, self.capacity = projection, capacity
        slice_m = (grid.upper_m[2] - grid.lower_m[2]) / num_heights
        z_m = grid.lower_m[2] + (torch.arange(num_heights) + 0.5) * slice_m
        points = grid.centers()[:, :, :1].repeat(1, 1, num_heights, 1)
        points[..., 2] = z_m

        self.register_buffer("points", points.flatten(0, 1), persistent=False)

    def forward(
        self,
        occ_from_body: Float[Tensor, "b 4 4"],
        body_from_camera: Float[Tensor, "b 4 4"],
        pix_from_camera: Float[Tensor, "b 3 3"],
        image_size: tuple[int, int],
        height_m: Float[Tensor, "b"] | None = None,
    ) -> References:
        """``image_size`` is width and height in pixels; a ``height_m`` puts the grid on the ground.

        Raises `UserError` where more references are in view than ``capacity`` has room for; on a
        GPU, where asking would stall it, that is an assertion of the device.
        """
        if self.projection == "level":
            occ_from_body = torch.eye(4).to(occ_from_body).expand_as(occ_from_body)

        # Autocast would round pixel coordinates to 8 bits.
        with torch.autocast(occ_from_body.device.type, enabled=False):
            chain = camera_from_occ(occ_from_body.float(), body_from_camera.float())
            if height_m is not None:
                chain = chain @ occ_from_ground(height_m.float())
            pix_from_camera = pix_from_camera.float()
            pix, depth_m = project(self.points.flatten(0, 1), chain, pix_from_camera)

        valid = in_image(pix, depth_m, *image_size)
        pillars = self.points.shape[:2]
        by_pillar = (x.unflatten(1, pillars) for x in (pix, depth_m, valid))
        return References(*by_pillar, self._in_view(valid), chain, pix_from_camera)

    def _in_view(self, valid: Bool[Tensor, "b n"]) -> Int[Tensor, "r"]:
        capacity = 1.0 if torch.compiler.is_exporting() else self.capacity
        if capacity is None:
            return valid.flatten().nonzero()[:, 0]
        room = math.ceil(capacity * valid.shape[1])
        if room < valid.shape[1] and not torch.compiler.is_compiling():
            _require_room(valid, room)
        return padded_index(valid, room)


def rays_camera(
    width: int, height: int, stride: int, pix_from_camera: Float[Tensor, "b 3 3"]
) -> Float[Tensor, "b n 3"]:
    """Returns the points of the pixels of a level at a depth of one metre, row by row.

    This is `unproject` without a matrix inversion, for which ONNX has no operator. The camera
    matrix is upper triangular.
    """
    (focal_x, skew, u0), (_, focal_y, v0), _ = (
        row.unbind(-1) for row in pix_from_camera[..., None, :, :].unbind(-2)
    )
    u, v = (stride * pixel_centers(width, height)).flatten(0, 1).to(pix_from_camera).unbind(-1)
    y = (v - v0) / focal_y
    x = (u - u0 - skew * y) / focal_x
    return torch.stack([x, y, torch.ones_like(x)], dim=-1)


def padded_index(valid: Bool[Tensor, "b n"], room: int) -> Int[Tensor, "b*{room}"]:
    """Places in the flattened ``valid`` of each row's first ``room`` true ones, row by row.

    A row with fewer is padded with the number of all places. No shape depends on the values.
    """
    places = torch.arange(valid.numel(), device=valid.device).view_as(valid)
    if room == valid.shape[1]:
        return torch.where(valid, places, valid.numel()).flatten()
    slot = valid.cumsum(dim=1) - 1
    slot = torch.where(valid & (slot < room), slot, room)
    index = places.new_full((len(valid), room + 1), valid.numel())
    return index.scatter(1, slot, places)[:, :room].flatten()


def _require_room(valid: Bool[Tensor, "b n"], room: int) -> None:
    most, total = valid.sum(dim=1).max(), valid.shape[1]
    if most.is_cuda:
        message = (
            f"model.encoder.capacity: more than {room} references are in view; raise it, or null"
        )
        torch._assert_async(most <= room, message)
    elif most > room:
        raise UserError(
            f"model.encoder.capacity: {int(most)} of {total} references are in view, and there is "
            f"room for {room}; give {math.ceil(100 * int(most) / total) / 100} or more, or null"
        )
