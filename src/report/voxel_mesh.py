"""Voxels as triangle meshes of plotly, without the faces that nobody can see."""

from itertools import product

import numpy as np
import plotly.graph_objects as go
from jaxtyping import Bool, Int

from ..geometry import VoxelGrid
from ..ontology import CLASSES, COLORS, OCCUPIED
from .canvas import readable
from .view import Labels
from .voxels import IN_CORNER, IN_OPEN, openness

# The darkest that a face gets between its neighbors, as a share of its class's color.
DARKEST = 0.5

# Every mesh is drawn this way. The sun stands behind the UAV, to its left, and high, so that each
# side of a voxel has a tone of its own. Plotly's default would take faces of a metre for specks
# and leave them without a normal, hence the epsilon of zero.
LOOK = {
    "flatshading": True,
    "intensitymode": "cell",
    "cmin": IN_CORNER,
    "cmax": IN_OPEN,
    "showscale": False,
    "lightposition": {"x": -42_000, "y": 60_000, "z": 95_000},
    "lighting": {"ambient": 0.68, "diffuse": 0.5, "specular": 0.03, "facenormalsepsilon": 0},
    "hovertemplate": "%{fullData.name}<br>%{x} m ahead, %{y} m left, %{z} m up<extra></extra>",
}


def exposed_faces(
    solid: Bool[np.ndarray, "X Y Z"],
) -> tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, "n 4 3"]]:
    """Returns every face between a solid voxel and one that is not, or the grid's end.

    The first array holds the indices of the neighbor across the face, which may lie one voxel
    outside the grid. The second holds the four corners as indices of voxel corners,
    counterclockwise as seen from the neighbor.
    """
    padded = np.pad(solid, 1)
    faces = []

    for axis, step in product(range(3), (1, -1)):
        # The empty border keeps the two ends of the axis apart when the array is rolled.
        voxels = np.argwhere(padded & ~np.roll(padded, -step, axis)) - 1

        normal, u, v = np.roll(np.eye(3, dtype=int), axis, axis=1)
        first = normal * (1 + step) // 2
        square = np.stack([first, first + u, first + u + v, first + v])[::step]
        faces.append((voxels + step * normal, voxels[:, None] + square))

    return tuple(map(np.concatenate, zip(*faces)))


def voxel_meshes(labels: Labels, grid: VoxelGrid) -> list[go.Mesh3d]:
    """Returns a mesh of each occupied class that occurs, in metres of the occ frame.

    A face between two classes is kept on both sides, so that a class can be hidden without leaving
    holes.
    """
    is_open = openness(np.isin(labels, OCCUPIED))
    meshes = []

    for kind in OCCUPIED:
        neighbors, corners = exposed_faces(labels == kind)
        if len(corners) == 0:
            continue

        color = COLORS[CLASSES[kind]]
        dark = tuple(round(DARKEST * channel) for channel in color)
        # Corners are dark where the light of the sky does not reach.
        shade = {
            "intensity": is_open[tuple(neighbors.T + 1)].repeat(2),
            "colorscale": [(0, f"rgb{dark}"), (1, f"rgb{color}")],
        }
        name = readable(CLASSES[kind])
        meshes.append(go.Mesh3d(name=name, **LOOK, **shade, **_triangles(corners, grid)))

    return meshes


def _triangles(corners: Int[np.ndarray, "n 4 3"], grid: VoxelGrid) -> dict[str, np.ndarray]:
    """Returns the points x, y, z of faces in metres, and the points i, j, k of their triangles."""
    # Faces share their corners: that is half the points.
    lattice = np.add(grid.shape, 1)
    flat = np.ravel_multi_index(np.moveaxis(corners, -1, 0), lattice)
    points, index = np.unique(flat, return_inverse=True)

    indices = np.stack(np.unravel_index(points, lattice))
    points_m = (indices.T * grid.voxel_m + grid.lower_m).astype(np.float32)
    triangles = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    smallest = np.min_scalar_type(len(points))
    return dict(zip("xyzijk", [*points_m.T, *triangles.T.astype(smallest)]))
