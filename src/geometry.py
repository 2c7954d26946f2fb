"""Frames, rigid transforms, the projection chain and the voxel grid.

Every frame is right-handed, in metres and radians; `docs/conventions.md` lists them and
`tests/test_conventions.py` executes that page. A rigid transform is named ``<to>_from_<from>``: a
4x4 matrix that acts on column vectors, so neighbours must match::

    world_from_camera = world_from_body @ body_from_camera

Everything here takes any leading batch dimensions and keeps the dtype it is given. Rotations,
transforms and projections take tensors or numpy arrays, and return what they were given.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce, wraps
from numbers import Real

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from .errors import UserError

Array = Tensor | np.ndarray

# Nearer than this, in front of the lens, a point counts as not in the image.
MIN_DEPTH_M = 0.1
# A calibrated center further from the middle, as a share of a side, is that of another image size.
MIDDLE_SHARE, SKEWED = 0.25, 0.01
# Attitude filters in float32 leave rotations that are not orthonormal to the last digits.
ROTATION_TOLERANCE = 1e-3


def _numpy_too(function: Callable) -> Callable:
    """Lets a function of tensors take numpy arrays as well; it then returns arrays."""

    @wraps(function)
    def either(*args: object, **named: object) -> object:
        if not any(isinstance(value, np.ndarray) for value in (*args, *named.values())):
            return function(*args, **named)

        given = {**dict(enumerate(args)), **named}
        tensors = {
            key: tensor_of(value) for key, value in given.items() if isinstance(value, Array)
        }
        # Beside float64 numbers, float32 ones become float64 too, as in numpy.
        floats = {key: each for key, each in tensors.items() if each.is_floating_point()}
        common = reduce(torch.promote_types, [each.dtype for each in floats.values()], torch.half)
        given |= tensors | {key: each.to(common) for key, each in floats.items()}

        positional = [given.pop(n) for n in range(len(args))]
        result = function(*positional, **given)
        return tuple(map(np.asarray, result)) if isinstance(result, tuple) else result.numpy()

    return either


def tensor_of(array: Array) -> Tensor:
    """Returns a tensor as it is, and of an array, of any strides and byte order, a copy; of a
    longdouble one as float64."""
    if isinstance(array, Tensor):
        return array
    dtype = np.float64 if array.dtype == np.longdouble else array.dtype.newbyteorder("=")
    return torch.tensor(np.asarray(array, dtype, order="C"))


# ------------------------------------------------------------------------------------ rotations


@_numpy_too
def rotation_from_euler(
    roll_rad: Float[Array, "*#batch"],
    pitch_rad: Float[Array, "*#batch"],
    yaw_rad: Float[Array, "*#batch"],
) -> Float[Array, "*batch 3 3"]:
    """Rotation Rz(yaw) Ry(pitch) Rx(roll), which takes body axes to world axes.

    With x forward, y left and z up, positive pitch is nose down and positive roll is right side
    down. The angles only parameterise the quaternion of App. A.2; they are never added up.
    """
    roll_rad, pitch_rad, yaw_rad = torch.broadcast_tensors(roll_rad, pitch_rad, yaw_rad)
    cr, sr = torch.cos(roll_rad), torch.sin(roll_rad)
    cp, sp = torch.cos(pitch_rad), torch.sin(pitch_rad)
    cy, sy = torch.cos(yaw_rad), torch.sin(yaw_rad)
    rows = [
        torch.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], dim=-1),
        torch.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], dim=-1),
        torch.stack([-sp, cp * sr, cp * cr], dim=-1),
    ]

    return torch.stack(rows, dim=-2)


@_numpy_too
def euler_from_rotation(
    rotation: Float[Array, "*batch 3 3"],
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Roll, pitch and yaw in radians of a rotation; pitch within +-pi/2, inverting the above."""
    roll_rad = torch.atan2(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch_rad = torch.atan2(-rotation[..., 2, 0], rotation[..., :2, 0].norm(dim=-1))
    yaw_rad = torch.atan2(rotation[..., 1, 0], rotation[..., 0, 0])
    return roll_rad, pitch_rad, yaw_rad


@_numpy_too
def rotation_from_quat(quat_xyzw: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Rotation of a quaternion, scalar last; it is normalised first."""
    x, y, z, w = (quat_xyzw / quat_xyzw.norm(dim=-1, keepdim=True)).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], dim=-1),
        torch.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], dim=-1),
        torch.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], dim=-1),
    ]
    return torch.stack(rows, dim=-2)


@_numpy_too
def quat_from_euler(
    roll_rad: Float[Array, "*#batch"],
    pitch_rad: Float[Array, "*#batch"],
    yaw_rad: Float[Array, "*#batch"],
) -> Float[Array, "*batch 4"]:
    """Unit quaternion, scalar last, of Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = torch.cos(roll_rad / 2), torch.sin(roll_rad / 2)
    cp, sp = torch.cos(pitch_rad / 2), torch.sin(pitch_rad / 2)
    cy, sy = torch.cos(yaw_rad / 2), torch.sin(yaw_rad / 2)

    return torch.stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ],
        dim=-1,
    )


# ----------------------------------------------------------------------------- rigid transforms


@_numpy_too
def rigid(
    rotation: Float[Array, "*#batch 3 3"], translation_m: Float[Array, "*#batch 3"]
) -> Float[Array, "*batch 4 4"]:
    """The 4x4 matrix ``[R t; 0 1]``."""
    batch = torch.broadcast_shapes(rotation.shape[:-2], translation_m.shape[:-1])
    transform = rotation.new_zeros(*batch, 4, 4)
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = translation_m
    transform[..., 3, 3] = 1
    return transform


@_numpy_too
def inverse(b_from_a: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """``a_from_b`` of a rigid ``b_from_a``, without a matrix inversion."""
    a_from_b_rotation = b_from_a[..., :3, :3].transpose(-1, -2)
    return rigid(a_from_b_rotation, -(a_from_b_rotation @ b_from_a[..., :3, 3:])[..., 0])


def transform(
    b_from_a: Float[Array, "*#batch 4 4"], points_a: Float[Array, "*#batch n 3"]
) -> Float[Array, "*batch n 3"]:
    """Points of frame a, expressed in frame b."""
    return rotate(b_from_a, points_a) + b_from_a[..., None, :3, 3]


def rotate(
    b_from_a: Float[Array, "*#batch 4 4"], directions_a: Float[Array, "*#batch n 3"]
) -> Float[Array, "*batch n 3"]:
    """Directions of frame a, expressed in frame b."""
    return directions_a @ b_from_a[..., :3, :3].swapaxes(-1, -2)


@_numpy_too
def yaw_of(world_from_body: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch"]:
    """Yaw in radians, counter-clockwise from world x (east)."""
    return torch.atan2(world_from_body[..., 1, 0], world_from_body[..., 0, 0])


@_numpy_too
def world_from_occ(world_from_body: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """The paper's gravity-stabilised frame G_t (App. A.2): Rz(yaw) at the UAV's center."""
    yaw_rad = yaw_of(world_from_body)
    zero = torch.zeros_like(yaw_rad)
    return rigid(rotation_from_euler(zero, zero, yaw_rad), world_from_body[..., :3, 3])


@_numpy_too
def occ_from_body(world_from_body: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """Roll and pitch alone: the body's rotation seen from the frame that shares its yaw."""
    return inverse(world_from_occ(world_from_body)) @ world_from_body


def require_rigid(name: str, transform: Float[Tensor, "*batch 4 4"]) -> None:
    """Raises `UserError` for a matrix that is no rigid transform, as a transposed one is none."""
    last = torch.tensor([0.0, 0.0, 0.0, 1.0]).to(transform)
    if (transform[..., 3, :] != last).any():
        raise UserError(
            f"{name}: its last row is {transform[..., 3, :].flatten().tolist()[:4]} and must be 0, "
            "0, 0, 1; it acts on column vectors, so a row-major one is given transposed"
        )

    rotation = transform[..., :3, :3]
    off = (rotation @ rotation.transpose(-1, -2) - torch.eye(3).to(transform)).abs().max()
    if off > ROTATION_TOLERANCE or (torch.linalg.det(rotation.double()) < 0).any():
        raise UserError(
            f"{name}: its upper left part is no rotation (orthonormal, with a determinant of 1); "
            "take out scales and mirrored axes"
        )


def require_pinhole(name: str, pix_from_camera: Float[Tensor, "*batch 3 3"]) -> None:
    """Raises `UserError` for intrinsics without positive focal lengths, or of another form."""
    focal_pix = torch.stack([pix_from_camera[..., 0, 0], pix_from_camera[..., 1, 1]])
    last = torch.tensor([0.0, 0.0, 1.0]).to(pix_from_camera)
    if (focal_pix <= 0).any() or (pix_from_camera[..., 2, :] != last).any():
        raise UserError(
            f"{name}: must have positive focal lengths in pixels on its diagonal, and 0, 0, 1 as "
            "its last row"
        )


def require_middle(
    name: str, pix_from_camera: Float[Tensor, "3 3"], size_pix: tuple[int, int]
) -> None:
    """Raises `UserError` for a principal point far from the middle of an image, or a skew: of a
    camera of another size, or of no pixels."""
    middle = pix_from_camera[:2, 2] / torch.tensor(size_pix).to(pix_from_camera)
    skew = pix_from_camera[[0, 1], [1, 0]] / pix_from_camera[0, 0]
    if (abs(middle - 0.5) > MIDDLE_SHARE).any() or (abs(skew) > SKEWED).any():
        cx, cy = pix_from_camera[:2, 2].tolist()
        raise UserError(
            f"{name}: cx={cx:g}, cy={cy:g} is far from the middle of {size_pix[0]}x{size_pix[1]} "
            "pixels, or its axes are skew; scale a calibration of another size by the ratio of the "
            "widths"
        )


# ------------------------------------------------------------------------- the projection chain


@_numpy_too
def camera_from_occ(
    world_from_body: Float[Array, "*#batch 4 4"], body_from_camera: Float[Array, "*#batch 4 4"]
) -> Float[Array, "*batch 4 4"]:
    """The paper's T^{C<-G}_t (App. A.2): ``camera_from_body @ body_from_world @ world_from_occ``.

    Roll and pitch enter the chain here, once, through ``world_from_body``. Since the occ frame is a
    world whose origin and yaw are the UAV's, the chain also takes ``occ_from_body`` in the place
    of ``world_from_body``, and the result is the same; with the identity there it is the chain of a
    level UAV.
    """
    camera_from_body = inverse(body_from_camera)
    return camera_from_body @ inverse(world_from_body) @ world_from_occ(world_from_body)


@_numpy_too
def project(
    points_occ: Float[Array, "*#batch n 3"],
    camera_from_occ: Float[Array, "*#batch 4 4"],
    pix_from_camera: Float[Array, "*#batch 3 3"],
) -> tuple[Float[Array, "*batch n 2"], Float[Array, "*batch n"]]:
    """Image location ``(u, v)`` in pixels and z-depth in metres of points in the occ frame.

    The paper's attitude-aware projection (Eq. 5). Pixel (0, 0) covers [0, 1) x [0, 1). The location
    means nothing where the depth is not positive: ask `in_image`.
    """
    points_camera = transform(camera_from_occ, points_occ)
    depth_m = points_camera[..., 2]
    homogeneous = points_camera @ pix_from_camera.transpose(-1, -2)
    tiny = torch.finfo(depth_m.dtype).tiny ** 0.5
    divisor = torch.where(depth_m.abs() < tiny, torch.full_like(depth_m, tiny), depth_m)

    return homogeneous[..., :2] / divisor[..., None], depth_m


@_numpy_too
def unproject(
    pix: Float[Array, "*#batch n 2"],
    depth_m: Float[Array, "*#batch n"],
    pix_from_camera: Float[Array, "*#batch 3 3"],
) -> Float[Array, "*batch n 3"]:
    """Points in the camera frame of image locations with a z-depth: the inverse of `project`."""
    homogeneous = torch.cat([pix, torch.ones_like(pix[..., :1])], dim=-1)
    rays_camera = homogeneous @ torch.linalg.inv(pix_from_camera).transpose(-1, -2)
    return rays_camera * depth_m[..., None]


@_numpy_too
def in_image(
    pix: Float[Array, "*batch n 2"], depth_m: Float[Array, "*batch n"], width: int, height: int
) -> Bool[Array, "*batch n"]:
    """Marks the projected points that lie before the camera and inside the image."""
    u, v = pix.unbind(-1)
    return (depth_m > MIN_DEPTH_M) & (u >= 0) & (u < width) & (v >= 0) & (v < height)


def pinhole(width: int, height: int, hfov_rad: float) -> Float[Tensor, "3 3"]:
    """``pix_from_camera`` (float64) of a camera with square pixels and a centered optical axis.

    Raises `UserError` for a field of view of half a turn or more, or none.
    """
    if not 0 < hfov_rad < math.pi:
        raise UserError(f"hfov: {math.degrees(hfov_rad):g} degrees; give one between 0 and 180")
    focal_pix = width / 2 / math.tan(hfov_rad / 2)
    return torch.tensor(
        [[focal_pix, 0.0, width / 2], [0.0, focal_pix, height / 2], [0.0, 0.0, 1.0]],
        dtype=torch.float64,
    )


def pixel_centers(width: int, height: int) -> Float[Tensor, "h w 2"]:
    """``(u, v)`` of every pixel's center (float64): (0.5, 0.5) for the first."""
    v, u = torch.meshgrid(
        torch.arange(height, dtype=torch.float64) + 0.5,
        torch.arange(width, dtype=torch.float64) + 0.5,
        indexing="ij",
    )
    return torch.stack([u, v], dim=-1)


def front_mount(position_m: Sequence[float], pitch_rad: float = 0.0) -> Float[Tensor, "4 4"]:
    """``body_from_camera`` (float64) of a camera along body x, pitched down by an angle.

    Raises `UserError` for other than three finite numbers and an angle.
    """
    numbers = (*position_m, pitch_rad)
    if len(numbers) != 4 or not all(isinstance(n, Real) and math.isfinite(n) for n in numbers):
        raise UserError(
            f"position_m: {[*position_m]}, pitch {pitch_rad} rad; give three numbers: forward, "
            "left and up, and an angle"
        )

    body_from_level_camera = torch.tensor(
        [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], dtype=torch.float64
    )
    zero = torch.zeros((), dtype=torch.float64)
    tilt = rotation_from_euler(zero, torch.tensor(pitch_rad, dtype=torch.float64), zero)
    return rigid(tilt @ body_from_level_camera, torch.tensor(position_m, dtype=torch.float64))


# ------------------------------------------------------------------------------- the voxel grid


@dataclass(frozen=True)
class VoxelGrid:
    """Cubic voxels in the occ frame; index ``i`` covers ``[lower + i*s, lower + (i+1)*s)``.

    The default is the paper's grid. Any sequences will do; they become tuples. Raises `UserError`
    for a shape that does not divide the range into cubes.
    """

    lower_m: Sequence[float] = (0.0, -25.0, -20.0)
    upper_m: Sequence[float] = (50.0, 25.0, 10.0)
    shape: Sequence[int] = (100, 100, 60)

    def __post_init__(self) -> None:
        for name, kind in (("lower_m", float), ("upper_m", float), ("shape", int)):
            object.__setattr__(self, name, tuple(kind(value) for value in getattr(self, name)))
            if len(getattr(self, name)) != 3:
                raise UserError(f"grid.{name}: {list(getattr(self, name))}; give three numbers")
        if min(self.shape) < 1 or any(u <= l for l, u in zip(self.lower_m, self.upper_m)):
            raise UserError(f"grid: {self} is empty; every upper_m must exceed its lower_m")
        sides_m = [(u - l) / n for l, u, n in zip(self.lower_m, self.upper_m, self.shape)]
        if max(sides_m) - min(sides_m) > 1e-6 * max(sides_m):
            extent_m = [u - l for l, u in zip(self.lower_m, self.upper_m)]
            raise UserError(
                f"grid.shape: {list(self.shape)} does not divide the range {extent_m} m into "
                f"cubes: voxels of {[round(s, 4) for s in sides_m]} m; give them equal sides"
            )

    @property
    def voxel_m(self) -> float:
        """Side of a voxel in metres."""
        return (self.upper_m[0] - self.lower_m[0]) / self.shape[0]

    def centers(
        self, dtype: torch.dtype = torch.float32, device: torch.device | str | None = None
    ) -> Float[Tensor, "X Y Z 3"]:
        """Center of every voxel in metres, in the occ frame."""
        axes = [
            lower + (torch.arange(n, dtype=dtype, device=device) + 0.5) * self.voxel_m
            for lower, n in zip(self.lower_m, self.shape)
        ]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)

    @_numpy_too
    def index_of(
        self, points: Float[Array, "*batch 3"]
    ) -> tuple[Int[Array, "*batch 3"], Bool[Array, "*batch"]]:
        """Voxel index (int64) of points in the occ frame, and which of them lie in the grid.

        Floor first, then the bounds test, so that a point just outside is never rounded inside;
        indices of points outside are not clamped. NaN and infinite points are outside.
        """
        lower = torch.tensor(self.lower_m, dtype=points.dtype, device=points.device)
        shape = torch.tensor(self.shape, device=points.device)
        cell = torch.floor((points - lower) / self.voxel_m)
        inside = ((cell >= 0) & (cell < shape)).all(dim=-1)
        finite = torch.nan_to_num(cell, nan=-1.0, posinf=2.0**31, neginf=-(2.0**31))
        return finite.clamp(-(2.0**31), 2.0**31).to(torch.int64), inside
