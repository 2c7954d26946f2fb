"""The loops of the annotation that numpy cannot run: over rays, points and voxels.

Every one is a plain loop over its first argument that writes into an array it is given. ``grid``
arguments are the numbers of a `geometry.VoxelGrid`: its lower corner and the side of its voxels.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import MIN_DEPTH_M
from ..jit import njit
from ..ontology import FREE, RAREST_FIRST, UNKNOWN
from ..voxels import advance, enter, is_inside

_ORDER = np.array(RAREST_FIRST, dtype=np.uint8)


@njit(error_model="numpy")
def carve(
    free: UInt8[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    cell_m: float,
    origin_m: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    distance_m: Float[np.ndarray, "n"],
) -> None:
    """Marks every cell that a ray leaves before its end.

    The cell in which a ray ends is not marked: there is a surface in it. A ray that starts outside
    the map marks nothing.
    """
    origin = (origin_m - lower_m) / cell_m
    for axis in range(3):
        if not 0 <= origin[axis] < free.shape[axis]:
            return

    direction = np.empty(3)
    for n in range(len(directions)):
        for axis in range(3):
            direction[axis] = directions[n, axis] / cell_m
        ray = enter(free.shape, origin, direction)
        while is_inside(free.shape, ray):
            cell = ray.cell
            ray = advance(ray)
            if ray.distance > distance_m[n]:
                break
            free[cell] = 1


@njit
def voxel_of(
    point: Float[np.ndarray, "3"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    shape: tuple[int, int, int],
) -> tuple[int, int, int]:
    """Index of the voxel around a point: floor first, then the bounds; (-1, 0, 0) outside."""
    x = np.floor((point[0] - lower_m[0]) / voxel_m)
    y = np.floor((point[1] - lower_m[1]) / voxel_m)
    z = np.floor((point[2] - lower_m[2]) / voxel_m)
    if 0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]:
        return int(x), int(y), int(z)
    return -1, 0, 0


@njit
def count_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
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
        x, y, z = voxel_of(point, lower_m, voxel_m, votes.shape[:3])
        if x >= 0:
            votes[x, y, z, class_id[i]] += 1


@njit
def count_pixel_votes(
    votes: Int[np.ndarray, "X Y Z 8"],
    seen: Bool[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    occ_from_pix: Float[np.ndarray, "3 4"],
    depth_m: Float[np.ndarray, "h w"],
    class_id: UInt8[np.ndarray, "h w"],
) -> None:
    """Adds one vote per pixel that shows something, and marks the voxels that have one as seen.

    ``occ_from_pix`` takes (u d, v d, d, 1) of pixel centers with depth d to the occ frame.
    """
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
            x, y, z = voxel_of(point, lower_m, voxel_m, seen.shape)
            if x >= 0:
                votes[x, y, z, class_id[row, column]] += 1
                seen[x, y, z] = True


@njit
def see_centers(
    inside: Bool[np.ndarray, "X Y Z"],
    before: Bool[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    pix_from_occ: Float[np.ndarray, "3 4"],
    depth_m: Float[np.ndarray, "h w"],
    clearance_m: float,
) -> None:
    """Marks voxels whose center lies in the image, and of these the ones that lie before the
    depth of their pixel by more than a clearance. The formulas are `project`'s and `in_image`'s."""
    height, width = depth_m.shape
    of_x, of_y, of_z, offset = pix_from_occ.T
    for i in range(inside.shape[0]):
        x = lower_m[0] + (i + 0.5) * voxel_m
        for j in range(inside.shape[1]):
            y = lower_m[1] + (j + 0.5) * voxel_m
            # Scalars, not arrays of three: the loop is then several times as fast.
            column_u = of_x[0] * x + of_y[0] * y + offset[0]
            column_v = of_x[1] * x + of_y[1] * y + offset[1]
            column_depth = of_x[2] * x + of_y[2] * y + offset[2]
            for k in range(inside.shape[2]):
                z = lower_m[2] + (k + 0.5) * voxel_m
                depth = column_depth + of_z[2] * z
                if depth <= MIN_DEPTH_M:
                    continue
                u = (column_u + of_z[0] * z) / depth
                v = (column_v + of_z[1] * z) / depth
                if 0 <= u < width and 0 <= v < height:
                    inside[i, j, k] = True
                    before[i, j, k] = depth < depth_m[int(v), int(u)] - clearance_m


@njit
def look_up(
    found: Bool[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    world_from_occ: Float[np.ndarray, "4 4"],
    cells: UInt8[np.ndarray, "x y z"],
    cells_lower_m: Float[np.ndarray, "3"],
    cell_m: float,
) -> None:
    """Marks the voxels whose center lies in a set cell of a map of the world.

    The occ frame is upright, so that a column of voxels stands in one column of the map.
    """
    for i in range(found.shape[0]):
        x = lower_m[0] + (i + 0.5) * voxel_m
        for j in range(found.shape[1]):
            y = lower_m[1] + (j + 0.5) * voxel_m
            place = world_from_occ[:, 0] * x + world_from_occ[:, 1] * y + world_from_occ[:, 3]
            a = int(np.floor((place[0] - cells_lower_m[0]) / cell_m))
            b = int(np.floor((place[1] - cells_lower_m[1]) / cell_m))
            if not (0 <= a < cells.shape[0] and 0 <= b < cells.shape[1]):
                continue
            for k in range(found.shape[2]):
                z = place[2] + lower_m[2] + (k + 0.5) * voxel_m
                c = int(np.floor((z - cells_lower_m[2]) / cell_m))
                if 0 <= c < cells.shape[2] and cells[a, b, c]:
                    found[i, j, k] = True


@njit
def mark_box(
    marked: Bool[np.ndarray, "X Y Z"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    occ_from_box: Float[np.ndarray, "4 4"],
    half_m: Float[np.ndarray, "3"],
) -> None:
    """Marks the voxels whose center lies in an upright box around the origin of its own frame."""
    reach_m = np.hypot(half_m[0], half_m[1])
    middle = occ_from_box[:3, 3]
    offset = np.empty(3)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        reach = half_m[2] if axis == 2 else reach_m
        near = np.floor((middle[axis] - reach - lower_m[axis]) / voxel_m)
        far = np.ceil((middle[axis] + reach - lower_m[axis]) / voxel_m)
        low[axis] = max(near, 0)
        high[axis] = min(far, marked.shape[axis])
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                offset[0] = lower_m[0] + (i + 0.5) * voxel_m - middle[0]
                offset[1] = lower_m[1] + (j + 0.5) * voxel_m - middle[1]
                offset[2] = lower_m[2] + (k + 0.5) * voxel_m - middle[2]
                within = True
                for axis in range(3):
                    along = 0.0
                    for other in range(3):
                        along += occ_from_box[other, axis] * offset[other]
                    within &= abs(along) <= half_m[axis]
                if within:
                    marked[i, j, k] = True


@njit
def elect_classes(
    semantics: UInt8[np.ndarray, "X Y Z"],
    votes: Int[np.ndarray, "X Y Z 8"],
    free: Bool[np.ndarray, "X Y Z"],
) -> None:
    """The class with most votes, of equals the rarer one; without votes free, or else unknown."""
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


@njit
def settle(
    semantics: UInt8[np.ndarray, "n"],
    visible: Bool[np.ndarray, "n"],
    inside: Bool[np.ndarray, "n"],
    seen: Bool[np.ndarray, "n"],
    seen_free: Bool[np.ndarray, "n"],
) -> None:
    """Makes unknown what is not in the image, and marks as visible what the camera sees itself:
    the surfaces in ``seen``, the free voxels in ``seen_free``."""
    for i in range(len(semantics)):
        if not inside[i]:
            semantics[i] = UNKNOWN
        visible[i] = (semantics[i] < FREE and seen[i]) or (semantics[i] == FREE and seen_free[i])


@njit
def least_of_neighbours(least: Float[np.ndarray, "h w"], image: Float[np.ndarray, "h w"]) -> None:
    """The smallest value of every pixel and its eight neighbours."""
    height, width = image.shape
    for row in range(height):
        for column in range(width):
            value = np.float32(np.inf)
            for r in range(max(row - 1, 0), min(row + 2, height)):
                for c in range(max(column - 1, 0), min(column + 2, width)):
                    value = min(value, image[r, c])
            least[row, column] = value
