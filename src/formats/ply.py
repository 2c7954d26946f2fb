"""PLY: the occupied voxels of a frame as colored points, for MeshLab, CloudCompare and Open3D."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ..geometry import VoxelGrid
from ..ontology import CLASSES, COLORS, FREE

VERTEX = np.dtype(
    [(axis, "<f4") for axis in "xyz"]
    + [(name, "u1") for name in ("red", "green", "blue", "class_id")]
)
TYPES = {"<f4": "float", "|u1": "uchar"}


def write_ply(path: Path, grid: VoxelGrid, labels: UInt8[np.ndarray, "X Y Z"]) -> None:
    """Writes the centers of the occupied voxels in the frame ``occ`` (metres), with color and class
    id; binary, little endian."""
    occupied = labels < FREE
    vertices = np.empty(int(occupied.sum()), VERTEX)
    vertices["class_id"] = labels[occupied]
    for axis, values in zip("xyz", grid.centers().numpy()[occupied].T):
        vertices[axis] = values
    colors = np.array([COLORS[name] for name in CLASSES], np.uint8)[vertices["class_id"]]
    for name, values in zip(("red", "green", "blue"), colors.T):
        vertices[name] = values

    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"comment class {number} {name}" for number, name in enumerate(CLASSES[:FREE])]
    header += [f"comment voxels of {grid.voxel_m} m", f"element vertex {len(vertices)}"]
    header += [f"property {TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names]
    path.write_bytes("\n".join([*header, "end_header", ""]).encode() + vertices.tobytes())
