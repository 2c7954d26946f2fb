"""The loops of the annotation that numpy runs slowly or not at all: over rays, points and voxels.

A `Lattice` places an array of voxels in space, or of the smaller cells of a map.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import MIN_DEPTH_M, VoxelGrid
from ..jit import njit
from ..ontology import FREE, RAREST_FIRST, UNKNOWN
from ..voxels import advance, enter, is_inside

_ORDER = np.array(RAREST_FIRST, dtype=np.uint8)

Points = Float[np.ndarray, "n 3"]


class Lattice(NamedTuple):
    """Cubes side by side: the lower corner of the first one (float64), and their side."""

    lower_m: Float[np.ndarray, "3"]
    side_m: float

    @classmethod
    def of(cls, grid: VoxelGrid) -> "Lattice":
        return cls(np.array(grid.lower_m, dtype=np.float64), grid.voxel_m)


def centers_of(grid: VoxelGrid) -> list[Float[np.ndarray, "*xyz"]]:
    """Returns x, y and z of the centers of a grid's voxels, which broadcast to its shape."""
    axes_m = [
        lower_m + (np.arange(count) + 0.5) * grid.voxel_m
        for lower_m, count in zip(grid.lower_m, grid.shape)
    ]
    return np.meshgrid(*axes_m, indexing="ij", sparse=True)


@njit(error_model="numpy")
def carve(
    free: UInt8[np.ndarray, "X Y Z"],
    cells: Lattice,
    origin_m: Float[np.ndarray, "3"],
    directions: Points,
    distance_m: Float[np.ndarray, "n"],
) -> None:
    """Marks every cell that a ray leaves before its end.

    The cell in which a ray ends is not marked: there is a surface in it. A ray that starts outside
    the map marks nothing.
    """
    origin = (origin_m - cells.lower_m) / cells.side_m
    for axis in range(3):
        if not 0 <= origin[axis] < free.shape[axis]:
            return

    direction = np.empty(3)
    for n in range(len(directions)):
        for axis in range(3):
            direction[axis] = directions[n, axis] / cells.side_m
        ray = enter(free.shape, origin, direction)
        while is_inside(free.shape, ray):
            cell = ray.cell
            ray = advance(ray)
            if ray.distance > distance_m[n]:
                break
            free[cell] = 1


@njit
def count_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    voxels: Lattice,
    occ_from_points: Float[np.ndarray, "4 4"],
    points_m: Points,
    class_id: UInt8[np.ndarray, "n"],
) -> None:
    """Adds one vote per point to its voxel and class; points outside the grid have none, nor have
    those without a class.

    Floor comes first and the bounds after it: a point just below the grid is outside.
    """
    cell = np.empty(3)
    for i in range(len(points_m)):
        for k in range(3):
            place_m = occ_from_points[k, 3]
            for axis in range(3):
                place_m += occ_from_points[k, axis] * points_m[i, axis]
            cell[k] = np.floor((place_m - voxels.lower_m[k]) / voxels.side_m)

        x, y, z = cell
        inside = 0 <= x < votes.shape[0] and 0 <= y < votes.shape[1] and 0 <= z < votes.shape[2]
        if inside and class_id[i] < votes.shape[3]:
            votes[int(x), int(y), int(z), class_id[i]] += 1


@njit
def see_centers(
    shape: tuple[int, int, int],
    voxels: Lattice,
    pix_from_occ: Float[np.ndarray, "3 4"],
    depth_m: Float[np.ndarray, "h w"],
    clearance_m: float,
) -> tuple[Bool[np.ndarray, "X Y Z"], Bool[np.ndarray, "X Y Z"]]:
    """Returns the voxels whose center lies in the image, and those that lie before its depth.

    They lie before it by more than a clearance. The formulas are `project`'s and `in_image`'s.
    """
    height, width = depth_m.shape
    of_x, of_y, of_z, offset = pix_from_occ.T
    inside, before = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)

    for i in range(shape[0]):
        x = voxels.lower_m[0] + (i + 0.5) * voxels.side_m
        for j in range(shape[1]):
            y = voxels.lower_m[1] + (j + 0.5) * voxels.side_m
            # Scalars, not arrays of three: the loop is then several times as fast.
            column_u = of_x[0] * x + of_y[0] * y + offset[0]
            column_v = of_x[1] * x + of_y[1] * y + offset[1]
            column_depth = of_x[2] * x + of_y[2] * y + offset[2]

            for k in range(shape[2]):
                z = voxels.lower_m[2] + (k + 0.5) * voxels.side_m
                depth = column_depth + of_z[2] * z
                if depth <= MIN_DEPTH_M:
                    continue
                u = (column_u + of_z[0] * z) / depth
                v = (column_v + of_z[1] * z) / depth
                if 0 <= u < width and 0 <= v < height:
                    inside[i, j, k] = True
                    before[i, j, k] = depth < depth_m[int(v), int(u)] - clearance_m

    return inside, before


@njit
def elect(
    votes: Int[np.ndarray, "X Y Z 8"], free: Bool[np.ndarray, "X Y Z"]
) -> UInt8[np.ndarray, "X Y Z"]:
    """Elects the class with most votes in every voxel; without votes it is free or unknown.

    A tie goes to the rarer class, and occupied beats free.
    """
    semantics = np.empty(free.shape, dtype=np.uint8)
    pairs = votes.view(np.int64)
    for i in range(semantics.shape[0]):
        for j in range(semantics.shape[1]):
            for k in range(semantics.shape[2]):
                most, winner = 0, FREE if free[i, j, k] else UNKNOWN
                # Most voxels have no vote at all.
                two = pairs[i, j, k]
                if two[0] | two[1] | two[2] | two[3]:
                    for class_id in _ORDER:
                        if votes[i, j, k, class_id] > most:
                            most, winner = votes[i, j, k, class_id], class_id
                semantics[i, j, k] = winner
    return semantics
