"""How a ray goes through a voxel grid: one march for scores, labels of pixels and figures.

Compiled code walks along a ray in three lines (Amanatides and Woo, 1987)::

    ray = enter(shape, origin, direction)
    while is_inside(shape, ray):
        ...  # here is ray.cell, entered at ray.distance
        ray = advance(ray)

Everything is in grid coordinates: one unit is a voxel and voxel ``(i, j, k)`` covers
``[i, i+1) x [j, j+1) x [k, k+1)``; distances are in lengths of the ray's direction.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from .geometry import VoxelGrid, inverse, rotate, unproject
from .jit import njit


class Ray(NamedTuple):
    """A ray in one of the voxels that it passes.

    ``axis`` is that of the face through which the ray came in, or -1 where it starts in this voxel.
    ``borders`` are the distances at which the next voxel begins along each axis, ``steps`` the way
    the index then goes, and ``widths`` what a voxel adds to the distance.
    """

    cell: tuple[int, int, int]
    distance: float
    axis: int
    borders: tuple[float, float, float]
    steps: tuple[int, int, int]
    widths: tuple[float, float, float]


# Where a ray is that passes no voxel of the grid (any more).
NOWHERE, NEVER = (-1, -1, -1), (np.inf, np.inf, np.inf)


@njit(error_model="numpy")
def enter(shape, origin, direction):
    """Returns a `Ray` in the first voxel of a grid that it passes."""
    distance, axis = _entry(shape, origin, direction)
    if distance == np.inf:
        return Ray(NOWHERE, distance, -1, NEVER, (0, 0, 0), NEVER)

    i, step_i, border_i, width_i = _along(origin[0], direction[0], distance, shape[0])
    j, step_j, border_j, width_j = _along(origin[1], direction[1], distance, shape[1])
    k, step_k, border_k, width_k = _along(origin[2], direction[2], distance, shape[2])

    borders, widths = (border_i, border_j, border_k), (width_i, width_j, width_k)
    return Ray((i, j, k), distance, axis, borders, (step_i, step_j, step_k), widths)


@njit(error_model="numpy")
def _entry(shape, origin, direction):
    """Returns where a ray enters the grid and through which axis; -1 where it starts inside."""
    t_in, t_out, axis = 0.0, np.inf, -1
    for a in range(3):
        if direction[a] == 0.0:
            if not 0 <= origin[a] < shape[a]:
                return np.inf, -1
            continue
        near = (0.0 - origin[a]) / direction[a]
        far = (shape[a] - origin[a]) / direction[a]
        if near > far:
            near, far = far, near
        if near > t_in:
            t_in, axis = near, a
        t_out = min(t_out, far)

    return (t_in, axis) if t_in < t_out else (np.inf, -1)


@njit(error_model="numpy")
def _along(origin, direction, distance, size):
    """Returns the first voxel along one axis, the step, the next voxel's distance, and a width."""
    # The entry may round to just outside the grid.
    cell = min(max(int(np.floor(origin + distance * direction)), 0), size - 1)
    if direction == 0.0:
        return cell, 0, np.inf, np.inf

    step = 1 if direction > 0 else -1
    return cell, step, (cell + (step > 0) - origin) / direction, abs(1.0 / direction)


@njit(error_model="numpy")
def is_inside(shape, ray):
    """Tells whether a ray is still in the grid."""
    i, j, k = ray.cell
    # As an unsigned number, an index below 0 is beyond any size: one comparison an axis.
    in_i = np.uint64(i) < np.uint64(shape[0])
    in_j = np.uint64(j) < np.uint64(shape[1])
    in_k = np.uint64(k) < np.uint64(shape[2])
    return in_i and in_j and in_k


@njit(error_model="numpy")
def advance(ray):
    """Returns the ray in the next voxel, through the nearest of the three borders."""
    # Scalars, and no array of three: arrays make the march several times as slow.
    (i, j, k), (border_i, border_j, border_k) = ray.cell, ray.borders
    (step_i, step_j, step_k), (width_i, width_j, width_k) = ray.steps, ray.widths

    if border_i < border_j and border_i < border_k:
        borders = (border_i + width_i, border_j, border_k)
        return Ray((i + step_i, j, k), border_i, 0, borders, ray.steps, ray.widths)
    if border_j < border_k:
        borders = (border_i, border_j + width_j, border_k)
        return Ray((i, j + step_j, k), border_j, 1, borders, ray.steps, ray.widths)
    borders = (border_i, border_j, border_k + width_k)
    return Ray((i, j, k + step_k), border_k, 2, borders, ray.steps, ray.widths)


@njit(error_model="numpy")
def first_hit(occupied, origin, direction):
    """Returns the first occupied voxel, its distance and the axis of the face; axis -1 for none.

    The voxel that holds the origin does not count.
    """
    ray = enter(occupied.shape, origin, direction)
    while is_inside(occupied.shape, ray):
        if ray.axis >= 0 and occupied[ray.cell]:
            return ray.cell, ray.distance, ray.axis
        ray = advance(ray)

    return NOWHERE, np.inf, -1


def rays_in_grid(
    pix: Float[Tensor, "n 2"],
    camera_from_occ: Float[Tensor, "4 4"],
    pix_from_camera: Float[Tensor, "3 3"],
    grid: VoxelGrid,
) -> tuple[Float[Tensor, "3"], Float[Tensor, "n 3"]]:
    """Origin and directions (float64) of the rays through image locations, in grid coordinates.

    A direction is a metre of z-depth long, so distances in its lengths are z-depths in metres.
    """
    occ_from_camera = inverse(camera_from_occ.double())
    one_metre = torch.ones(len(pix), dtype=torch.float64)
    rays_camera = unproject(pix.double(), one_metre, pix_from_camera.double())
    directions = rotate(occ_from_camera, rays_camera) / grid.voxel_m

    return (occ_from_camera[:3, 3] - torch.tensor(grid.lower_m)) / grid.voxel_m, directions
