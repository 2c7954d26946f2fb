"""Triangles of solids and ground patches: what the renderer draws and the rays hit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..geometry import rotate, transform
from .layout import GroundPatch, HeightField
from .solid import Solid
from .towns.polyline import arc_m

Points = Float[np.ndarray, "n 3"]
Size = Float[np.ndarray, "3"]

# Sides of a tessellated circle; the corners lie on the circle.
ROUND_SIDES = 8

# A ground patch follows the terrain in quads of at most this side, and its edge reaches down by the
# skirt, so that no gap opens under a kerb.
GROUND_STEP_M = 4.0
SKIRT_M = 0.6


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, counter-clockwise from outside; ``uvs_m`` are metres along its surface."""

    vertices_m: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    uvs_m: Float[np.ndarray, "v 2"]
    faces: Int[np.ndarray, "f 3"]

    def moved(self, b_from_a: Float[np.ndarray, "4 4"]) -> "Mesh":
        """Returns the mesh, given in frame a, in frame b."""
        vertices_m = transform(b_from_a, self.vertices_m)
        return Mesh(vertices_m, rotate(b_from_a, self.normals), self.uvs_m, self.faces)

    def bounding_sphere(self) -> tuple[Float[np.ndarray, "3"], float]:
        """Middle and radius of a sphere around it: not the least one, but a tight one."""
        middle_m = (self.vertices_m.min(axis=0) + self.vertices_m.max(axis=0)) / 2
        return middle_m, float(np.linalg.norm(self.vertices_m - middle_m, axis=1).max())


def split(mesh: Mesh, cell_m: float) -> dict[tuple[int, int], Mesh]:
    """Cuts a mesh by square cells: each triangle goes whole to the cell of its middle."""
    middle_m = mesh.vertices_m[mesh.faces, :2].mean(axis=1)
    cells, owner = np.unique(np.floor(middle_m / cell_m).astype(int), axis=0, return_inverse=True)

    pieces = {}
    for index, cell in enumerate(cells.tolist()):
        used, corners = np.unique(mesh.faces[owner.reshape(-1) == index], return_inverse=True)
        pieces[tuple(cell)] = Mesh(
            mesh.vertices_m[used], mesh.normals[used], mesh.uvs_m[used], corners.reshape(-1, 3)
        )
    return pieces


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """Returns one mesh with the triangles of all, in their order."""
    starts = np.cumsum([0] + [len(mesh.vertices_m) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts)])
    parts = zip(*((mesh.vertices_m, mesh.normals, mesh.uvs_m) for mesh in meshes))
    return Mesh(*(np.concatenate(arrays) for arrays in parts), faces)


def mesh_of_solid(solid: Solid) -> Mesh:
    """Returns the solid's surface in its scene's frame."""
    size_m = np.asarray(solid.size_m, dtype=np.float64)
    build = {"box": _box, "cylinder": _cylinder, "cone": _cone, "ellipsoid": _ellipsoid}
    return build[solid.shape](size_m).moved(solid.scene_from_solid)


def mesh_of_patch(patch: GroundPatch, terrain: HeightField) -> Mesh:
    """Returns a ground patch draped over the terrain, with a skirt around it."""
    size_m = np.array([patch.length_m, patch.width_m])
    nx, ny = np.maximum(1, np.ceil(size_m / GROUND_STEP_M)).astype(int)
    along = np.linspace(-0.5, 0.5, nx + 1) * patch.length_m
    across = np.linspace(-0.5, 0.5, ny + 1) * patch.width_m
    along, across = np.meshgrid(along, across, indexing="ij")
    cos, sin = np.cos(patch.yaw_rad), np.sin(patch.yaw_rad)
    x = patch.origin_m[0] + cos * along - sin * across
    y = patch.origin_m[1] + sin * along + cos * across
    top = np.stack([x, y, terrain(x, y) + patch.rise_m], axis=-1)
    sheet = _sheet(top, np.stack([along, across], axis=-1) + size_m / 2)

    # The skirt hangs from the rim, which runs once around the patch.
    rim = np.concatenate([top[:-1, 0], top[-1, :-1], top[:0:-1, -1], top[0, :0:-1], top[:1, 0]])
    run_m = arc_m(rim)
    wall_uvs_m = np.stack([run_m, 0 * run_m], axis=-1)
    wall = np.stack([rim - [0, 0, SKIRT_M], rim], axis=1)
    return merge([sheet, _sheet(wall, np.stack([wall_uvs_m, wall_uvs_m], axis=1))])


def _sheet(points_m: Float[np.ndarray, "n m 3"], uvs_m: Float[np.ndarray, "n m 2"]) -> Mesh:
    """A grid of quads whose normal is d/dn x d/dm."""
    n, m = points_m.shape[:2]
    a = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).reshape(-1)
    b, c, d = a + m, a + m + 1, a + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    flat = points_m.reshape(-1, 3)
    return Mesh(flat, _vertex_normals(flat, faces), uvs_m.reshape(-1, 2), faces)


def _vertex_normals(vertices_m: Points, faces: Int[np.ndarray, "f 3"]) -> Points:
    """The mean of the normals of the triangles at each vertex, weighted by their areas."""
    a, b, c = (vertices_m[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices_m)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _box(size_m: Size) -> Mesh:
    """Six separate sides, so that every edge stays sharp."""
    half = size_m / 2
    sides = []
    for axis, right, up in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        for sign in (-1.0, 1.0):
            # d/dn x d/dm must point outwards along the axis.
            flip = sign * np.linalg.det(np.eye(3)[[right, up, axis]])
            grid = np.zeros((2, 2, 3))
            grid[..., axis] = sign * half[axis]
            grid[..., right] = np.array([[-1.0], [1.0]]) * flip * half[right]
            grid[..., up] = np.array([[-1.0, 1.0]]) * half[up]

            # Textures start at a corner of each side and run along its own edges.
            uvs_m = np.stack([grid[..., right] + half[right], grid[..., up] + half[up]], axis=-1)
            sides.append(_sheet(grid, uvs_m))
    return merge(sides)


def _cap(ring: Points) -> Mesh:
    """A fan over a convex ring that runs counter-clockwise as seen from outside."""
    n = len(ring)
    faces = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    return Mesh(ring, _vertex_normals(ring, faces), ring[:, :2] - ring[:, :2].min(axis=0), faces)


def _ring(size_m: Size) -> Points:
    """The closed outline at the bottom of a round solid; its last corner is its first."""
    angle = np.linspace(0, 2 * np.pi, ROUND_SIDES + 1)
    x, y, z = size_m / 2
    return np.stack([x * np.cos(angle), y * np.sin(angle), np.full_like(angle, -z)], axis=1)


def _mantle(bottom: Points, top: Points) -> Mesh:
    run_m = arc_m(bottom)
    height_m = top[:, 2] - bottom[:, 2]
    uvs_m = np.stack([np.stack([run_m, 0 * run_m], -1), np.stack([run_m, height_m], -1)], axis=1)
    return _sheet(np.stack([bottom, top], axis=1), uvs_m)


def _cylinder(size_m: Size) -> Mesh:
    bottom = _ring(size_m)
    top = bottom * [1, 1, -1]
    return merge([_mantle(bottom, top), _cap(top[:-1]), _cap(bottom[-2::-1])])


def _cone(size_m: Size) -> Mesh:
    bottom = _ring(size_m)
    tip = np.broadcast_to([0, 0, size_m[2] / 2], bottom.shape)
    return merge([_mantle(bottom, tip), _cap(bottom[-2::-1])])


def _ellipsoid(size_m: Size) -> Mesh:
    around = np.linspace(0, 2 * np.pi, ROUND_SIDES + 1)[:, None]
    up = np.linspace(-np.pi / 2, np.pi / 2, ROUND_SIDES // 2 + 1)[None, :]
    x, y = np.cos(around) * np.cos(up), np.sin(around) * np.cos(up)
    unit = np.stack([x, y, np.sin(up) + 0 * around], axis=-1)
    uvs_m = np.stack(np.broadcast_arrays(around, up), axis=-1) * size_m[:2].mean() / 2
    return _sheet(unit * size_m / 2, uvs_m)
