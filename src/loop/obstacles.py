"""How near a moving body comes to anything: exact distances to the triangles of a scene."""

from typing import NamedTuple

import numpy as np

from ..geometry import inverse, transform
from ..jit import njit
from ..ontology import UNKNOWN
from ..sim.scene import Scene
from .vectors import Numbers, Triangles, Vector, dot, numbered

# Farther away than this nothing is looked for.
REACH_M = 2.0
# Side of the cells in which triangles are looked up.
CELL_M = 1.0


class Nearest(NamedTuple):
    """The nearest surface: its distance (`REACH_M` where all is farther), its class (255 without
    one), and the number of its actor, 0 for what stands still."""

    distance_m: float
    class_id: int
    actor_id: int


class Obstacles:
    """All surfaces of a scene between two corners, static and moving.

    A body that goes straight from one place to another comes as near to a triangle as the segment
    between them: thin wires are met at any speed.
    """

    def __init__(self, scene: Scene, lower_m: Vector, upper_m: Vector) -> None:
        triangles_m, self._class_id = Scene(scene.static, ()).triangles_at(0)
        self._static = _in_cells(triangles_m, lower_m - REACH_M, upper_m + REACH_M)
        self._actors = []
        for actor in scene.actors:
            corners_m = actor.triangles_m.reshape(-1, 3)
            # The radius of a sphere around the actor's origin that holds all of it.
            reach_m = np.linalg.norm(corners_m, axis=-1).max()
            # A face at the upper end begins a cell of its own.
            own = _in_cells(
                actor.triangles_m, corners_m.min(axis=0), corners_m.max(axis=0) + CELL_M
            )
            self._actors.append((actor, reach_m, own))

    def nearest(self, start_m: Vector, end_m: Vector, steps: tuple[int, int]) -> Nearest:
        """Returns the surface that is nearest to the way from a place to another.

        ``steps`` are those of the simulation at the start and at the end: actors move meanwhile.
        """
        distance_m, face = _nearest_in(*self._static, start_m, end_m, REACH_M)
        found = Nearest(distance_m, int(self._class_id[face]) if face >= 0 else UNKNOWN, 0)

        for actor, reach_m, own in self._actors:
            apart_m = np.linalg.norm(start_m - actor.position_m[steps[0]])
            if apart_m > REACH_M + reach_m + np.linalg.norm(end_m - start_m):
                continue
            # Seen from the actor, its own motion is the body's.
            way_m = [
                transform(inverse(actor.world_from_actor[step]), place_m[None])[0]
                for step, place_m in zip(steps, (start_m, end_m))
            ]
            distance_m, _ = _nearest_in(*own, *way_m, found.distance_m)
            if distance_m < found.distance_m:
                found = Nearest(distance_m, actor.class_id, actor.actor_id)
        return found


def _in_cells(
    triangles_m: Triangles, lower_m: Vector, upper_m: Vector
) -> tuple[Triangles, Vector, tuple[int, int, int], Numbers, Numbers]:
    """Sorts triangles into cells, in which their bounding boxes lie; the last one comes first.

    Returns them with the lattice's corner and shape, the index at which the faces of every cell
    begin, and the faces, cell after cell.
    """
    triangles_m = np.ascontiguousarray(triangles_m, dtype=np.float64)
    shape = tuple((np.ceil((upper_m - lower_m) / CELL_M).astype(int).clip(1)).tolist())
    triangles = (triangles_m - lower_m) / CELL_M
    low = np.floor(triangles.min(axis=1)).astype(np.int64).clip(0)
    high = np.floor(triangles.max(axis=1)).astype(np.int64).clip(max=np.array(shape) - 1)
    size = (high - low + 1).clip(0)
    face, number = numbered(size.prod(axis=1))
    number, k = np.divmod(number, size[face, 2])
    i, j = np.divmod(number, size[face, 1])

    cell = np.ravel_multi_index((low[face] + np.stack([i, j, k], axis=1)).T, shape)
    order = np.lexsort((-face, cell))
    first = np.searchsorted(cell[order], np.arange(np.prod(shape) + 1))
    return triangles_m, lower_m.astype(np.float64), shape, first, face[order]


@njit
def _nearest_in(triangles, lower, shape, first, faces, start, end, near):
    """Returns the distance of the nearest triangle of the cells around a segment, and its index;
    where none is nearer than ``near``, that and -1. Looks at each once."""
    at = -1
    is_new = np.ones(len(triangles), dtype=np.bool_)
    low = np.floor((np.minimum(start, end) - REACH_M - lower) / CELL_M).astype(np.int64)
    high = np.floor((np.maximum(start, end) + REACH_M - lower) / CELL_M).astype(np.int64) + 1

    for i in range(max(low[0], 0), min(high[0], shape[0])):
        for j in range(max(low[1], 0), min(high[1], shape[1])):
            for k in range(max(low[2], 0), min(high[2], shape[2])):
                cell = (i * shape[1] + j) * shape[2] + k
                for n in range(first[cell], first[cell + 1]):
                    f = faces[n]
                    if is_new[f]:
                        is_new[f] = False
                        distance = _apart(triangles[f], start, end, near)
                        if distance < near:
                            near, at = distance, f
    return near, at


@njit
def _apart(triangle, start, end, enough):
    """Returns the distance of a segment from a triangle, or something above ``enough``."""
    for a in range(3):
        low = min(triangle[0, a], triangle[1, a], triangle[2, a])
        high = max(triangle[0, a], triangle[1, a], triangle[2, a])
        if low > max(start[a], end[a]) + enough or high < min(start[a], end[a]) - enough:
            return np.inf

    if _pierces(triangle, start, end):
        return 0.0
    near = min(_from_face(triangle, start), _from_face(triangle, end))
    for corner in range(3):
        near = min(near, _between(start, end, triangle[corner], triangle[(corner + 1) % 3]))
    return near


@njit
def _pierces(triangle, start, end):
    """Tests a segment for an intersection with a triangle (Moeller and Trumbore, 1997)."""
    u, v, way = triangle[1] - triangle[0], triangle[2] - triangle[0], end - start
    across = np.cross(way, v)
    determinant = dot(u, across)
    if abs(determinant) < 1e-12:
        return False
    offset = start - triangle[0]
    a = dot(offset, across) / determinant
    turned = np.cross(offset, u)
    b, t = dot(way, turned) / determinant, dot(v, turned) / determinant
    return a >= 0 and b >= 0 and a + b <= 1 and 0 <= t <= 1


@njit
def _from_face(triangle, point):
    """Returns the distance of a point from the plane of a triangle, where it lies above the
    triangle; else inf, as an edge is nearer."""
    u, v, offset = triangle[1] - triangle[0], triangle[2] - triangle[0], point - triangle[0]
    normal = np.cross(u, v)
    area = dot(normal, normal)
    if area < 1e-18:
        return np.inf
    a, b = dot(np.cross(offset, v), normal) / area, dot(np.cross(u, offset), normal) / area
    if a < 0 or b < 0 or a + b > 1:
        return np.inf
    return abs(dot(offset, normal)) / np.sqrt(area)


@njit
def _between(a, b, c, d):
    """Returns the distance of two segments (Ericson, Real-Time Collision Detection, 5.1.9)."""
    along, other, offset = b - a, d - c, a - c
    aa, cc, ac = dot(along, along), dot(other, other), dot(along, other)
    ao, co = dot(along, offset), dot(other, offset)
    denominator = aa * cc - ac * ac
    s = min(max((ac * co - ao * cc) / denominator, 0.0), 1.0) if denominator > 1e-12 else 0.0

    t = (ac * s + co) / cc if cc > 1e-12 else 0.0
    # Beyond an end of the other, the end is nearest, and the first follows it.
    if t < 0 or t > 1:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ac * t - ao) / aa, 0.0), 1.0) if aa > 1e-12 else 0.0
    gap = offset + s * along - t * other
    return np.sqrt(dot(gap, gap))
