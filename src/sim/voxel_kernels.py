"""The loops of the annotation that numpy cannot run: over rays, points and voxels.

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


class Lattice(NamedTuple):
    """Cubes side by side: the lower corner of the first one (float64), and their side."""

    lower_m: Float[np.ndarray, "3"]
    side_m: float

    @classmethod
    def of(cls, grid: VoxelGrid) -> "Lattice":
        return cls(np.array(grid.lower_m, dtype=np.float64), grid.voxel_m)


@njit(error_model="numpy")
def carve(
    free: UInt8[np.ndarray, "X Y Z"],
    cells: Lattice,
    origin_m: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
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
def voxel_of(
    point: Float[np.ndarray, "3"], voxels: Lattice, shape: tuple[int, int, int]
) -> tuple[int, int, int]:
    """Returns the index of the voxel around a point; (-1, 0, 0) outside.

    Floor comes first and the bounds after it: a point just below the grid is outside.
    """
    x = np.floor((point[0] - voxels.lower_m[0]) / voxels.side_m)
    y = np.floor((point[1] - voxels.lower_m[1]) / voxels.side_m)
    z = np.floor((point[2] - voxels.lower_m[2]) / voxels.side_m)
    if 0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]:
        return int(x), int(y), int(z)
    return -1, 0, 0


@njit
def count_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    voxels: Lattice,
    occ_from_world: Float[np.ndarray, "4 4"],
    points_m: Float[np.ndarray, "n 3"],
    class_id: UInt8[np.ndarray, "n"],
) -> None:
    """Adds one vote per world point to its voxel and class; points outside the grid have none."""
    point = np.empty(3)
    for i in range(len(points_m)):
        for k in range(3):
            point[k] = occ_from_world[k, 3]
            for axis in range(3):
                point[k] += occ_from_world[k, axis] * points_m[i, axis]
        x, y, z = voxel_of(point, voxels, votes.shape[:3])
        if x >= 0:
            votes[x, y, z, class_id[i]] += 1


@njit
def count_pixel_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    voxels: Lattice,
    occ_from_pix: Float[np.ndarray, "3 4"],
    depth_m: Float[np.ndarray, "h w"],
    class_id: UInt8[np.ndarray, "h w"],
) -> Bool[np.ndarray, "X Y Z"]:
    """Adds one vote per pixel that shows something; returns the voxels in which there is one.

    ``occ_from_pix`` takes (u d, v d, d, 1) of pixel centers with depth d to the occ frame.
    """
    seen = np.zeros(votes.shape[:3], dtype=np.bool_)
    point = np.empty(3)
    for row in range(depth_m.shape[0]):
        for column in range(depth_m.shape[1]):
            depth = depth_m[row, column]
            if not np.isfinite(depth):
                continue

            u, v = column + 0.5, row + 0.5
            for k in range(3):
                ray = occ_from_pix[k, 0] * u + occ_from_pix[k, 1] * v + occ_from_pix[k, 2]
                point[k] = occ_from_pix[k, 3] + depth * ray
            x, y, z = voxel_of(point, voxels, seen.shape)
            if x >= 0:
                votes[x, y, z, class_id[row, column]] += 1
                seen[x, y, z] = True

    return seen


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
def look_up(
    shape: tuple[int, int, int],
    voxels: Lattice,
    world_from_occ: Float[np.ndarray, "4 4"],
    is_set: UInt8[np.ndarray, "x y z"],
    cells: Lattice,
) -> Bool[np.ndarray, "X Y Z"]:
    """Returns the voxels of that shape whose center lies in a set cell of a map of the world.

    The occ frame is upright, so that a column of voxels stands in one column of the map.
    """
    found = np.zeros(shape, dtype=np.bool_)
    for i in range(shape[0]):
        x = voxels.lower_m[0] + (i + 0.5) * voxels.side_m
        for j in range(shape[1]):
            y = voxels.lower_m[1] + (j + 0.5) * voxels.side_m
            place = world_from_occ[:, 0] * x + world_from_occ[:, 1] * y + world_from_occ[:, 3]
            a = int(np.floor((place[0] - cells.lower_m[0]) / cells.side_m))
            b = int(np.floor((place[1] - cells.lower_m[1]) / cells.side_m))
            if not (0 <= a < is_set.shape[0] and 0 <= b < is_set.shape[1]):
                continue

            for k in range(shape[2]):
                z = place[2] + voxels.lower_m[2] + (k + 0.5) * voxels.side_m
                c = int(np.floor((z - cells.lower_m[2]) / cells.side_m))
                if 0 <= c < is_set.shape[2] and is_set[a, b, c]:
                    found[i, j, k] = True

    return found


@njit
def mark_box(
    marked: Bool[np.ndarray, "X Y Z"],
    voxels: Lattice,
    occ_from_box: Float[np.ndarray, "4 4"],
    half_m: Float[np.ndarray, "3"],
) -> None:
    """Marks the voxels whose center lies in an upright box around the origin of its own frame."""
    lower_m, side_m = voxels
    middle = occ_from_box[:3, 3]
    # However it is turned, the box reaches no farther than this along each axis.
    flat_m = np.hypot(half_m[0], half_m[1])
    reach_m = np.array([flat_m, flat_m, half_m[2]])
    near = np.floor((middle - reach_m - lower_m) / side_m)
    far = np.ceil((middle + reach_m - lower_m) / side_m)
    low = np.maximum(near, 0).astype(np.int64)
    high = np.minimum(far, np.array(marked.shape)).astype(np.int64)

    offset = np.empty(3)
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                offset[0] = lower_m[0] + (i + 0.5) * side_m - middle[0]
                offset[1] = lower_m[1] + (j + 0.5) * side_m - middle[1]
                offset[2] = lower_m[2] + (k + 0.5) * side_m - middle[2]

                within = True
                for axis in range(3):
                    along = 0.0
                    for other in range(3):
                        along += occ_from_box[other, axis] * offset[other]
                    within &= abs(along) <= half_m[axis]

                if within:
                    marked[i, j, k] = True


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
