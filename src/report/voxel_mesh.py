"""Voxels as triangle meshes of plotly, without the faces that nobody can see."""

from collections.abc import Mapping
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import VoxelGrid
from ..ontology import CLASSES, COLORS, OCCUPIED
from .canvas import readable

Palette = Mapping[str, tuple[int, int, int]]
CLASS_PALETTE = {readable(CLASSES[kind]): COLORS[CLASSES[kind]] for kind in OCCUPIED}

# The darkest a face gets between its neighbors, as a share of its class's color, and how much
# darker every second voxel is: so a reader can count voxels on a plain wall.
DARKEST, CHECKER = 0.5, 0.04

# Every mesh is drawn this way. The sun stands behind the UAV, to its left, and high, so that each
# side of a voxel has a tone of its own. Plotly's default would take faces of a metre for specks
# and leave them without a normal, hence the epsilon of zero.
LOOK = {
    "type": "mesh3d",
    "flatshading": True,
    "intensitymode": "cell",
    "cmin": 0.3,
    "cmax": 0.64,
    "showscale": False,
    "lightposition": {"x": -42_000, "y": 60_000, "z": 95_000},
    "lighting": {"ambient": 0.68, "diffuse": 0.5, "specular": 0.03, "facenormalsepsilon": 0},
    "hovertemplate": "%{fullData.name}<extra></extra>",
}


def exposed_faces(
    solid: Bool[np.ndarray, "X Y Z"],
) -> tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, "n 3"], Int[np.ndarray, "n 4 3"]]:
    """Returns every face between a solid voxel and one that is not, or the grid's end.

    The first array holds the indices of the solid voxel, the second those of its neighbor across
    the face, which may lie one voxel outside the grid. The third holds the four corners as indices
    of voxel corners, counterclockwise as seen from the neighbor.
    """
    padded = np.pad(solid, 1)
    faces = []

    for axis, step in product(range(3), (1, -1)):
        # The empty border keeps the two ends of the axis apart when the array is rolled.
        is_exposed = padded & ~np.roll(padded, -step, axis)
        voxels = np.argwhere(is_exposed) - 1

        normal, u, v = np.roll(np.eye(3, dtype=int), axis, axis=1)
        first = normal * (1 + step) // 2
        square = np.stack([first, first + u, first + u + v, first + v])[::step]
        faces.append((voxels, voxels + step * normal, voxels[:, None] + square))

    voxels, neighbors, corners = (np.concatenate(parts) for parts in zip(*faces))
    return voxels, neighbors, corners


def openness(drawn: Bool[np.ndarray, "X Y Z"]) -> Float[np.ndarray, "X+2 Y+2 Z+2"]:
    """Returns the share of voxels that are not drawn, in the 3 x 3 x 3 voxels around each.

    The result has a border of one voxel, so that an index of `exposed_faces` plus one fits it.
    """
    count = np.pad(drawn, 2).astype(float)
    for axis in range(3):
        count = sum(np.roll(count, step, axis) for step in (-1, 0, 1))
    return 1 - count[1:-1, 1:-1, 1:-1] / 27


def voxel_meshes(kinds: UInt8[np.ndarray, "X Y Z"], grid: VoxelGrid, palette: Palette) -> list:
    """Returns one ``mesh3d`` trace of plotly for each kind that occurs, in metres of the occ frame.

    ``palette`` names and colors the kinds 0, 1, ...; a voxel of any other kind is not drawn. A face
    between two kinds is kept on both sides, so that a kind can be hidden without leaving holes. The
    ``meta`` of a trace is the flat index of the voxel of each face, which is two triangles.
    """
    is_open = openness(kinds < len(palette))
    meshes = []

    for kind, (name, color) in enumerate(palette.items()):
        voxels, neighbors, corners = exposed_faces(kinds == kind)
        if len(voxels) == 0:
            continue

        # Corners are dark where the light of the sky does not reach.
        brightness = is_open[tuple(neighbors.T + 1)] - CHECKER * (voxels.sum(axis=1) % 2)
        dark = tuple(round(DARKEST * channel) for channel in color)
        mesh = {
            "name": name,
            "meta": np.ravel_multi_index(voxels.T, grid.shape).tolist(),
            "intensity": brightness.round(2).repeat(2).tolist(),
            "colorscale": [(0, f"rgb{dark}"), (1, f"rgb{color}")],
        }
        meshes.append(LOOK | mesh | _triangles(corners, grid))

    return meshes


def _triangles(corners: Int[np.ndarray, "n 4 3"], grid: VoxelGrid) -> dict[str, list]:
    """Returns the points x, y, z of faces in metres, and the points i, j, k of their triangles."""
    # Faces share their corners: that is half the points, and a third less to compress.
    lattice = np.add(grid.shape, 1)
    flat = np.ravel_multi_index(np.moveaxis(corners, -1, 0), lattice)
    points, index = np.unique(flat, return_inverse=True)

    indices = np.stack(np.unravel_index(points, lattice), axis=-1)
    points_m = (indices * grid.voxel_m + grid.lower_m).round(3)
    triangles = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return dict(zip("xyzijk", [*points_m.T.tolist(), *triangles.T.tolist()]))
