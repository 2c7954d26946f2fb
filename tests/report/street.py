"""A synthetic street as a label grid, for the tests of the figures."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import UInt8

from src import geometry, ontology
from src.geometry import VoxelGrid
from src.ontology import CAR, FREE, UNKNOWN
from src.report.scene import VoxelScene
from src.report.view import Frustum

GRID, SMALL = VoxelGrid(shape=(50, 50, 30)), VoxelGrid(shape=(25, 25, 15))
WIDTH, HEIGHT = 224, 128

FLOOR = (ontology.GROUND, (0, -25, -11), (50, 25, -10))
BOXES = (
    FLOOR,
    (ontology.GROUND, (0, 7, -10), (50, 25, -9.5)),
    (ontology.BUILDING, (10, 12, -10), (26, 24, 4)),
    (ontology.BUILDING, (38, -25, -10), (50, -12, 8)),
    (ontology.CAR, (20, 2, -10), (25, 4, -8)),
    (ontology.LARGE_VEHICLE, (24, -5, -10), (32, -2, -6)),
    (ontology.VRU, (17, 8, -10), (18, 9, -8)),
    (ontology.GENERAL, (22, -10, -10), (24, -9, -8)),
    (ontology.THIN_STRUCTURE, (28, 8, -10), (29, 9, 0)),
    (ontology.THIN_STRUCTURE, (28, -10, -1), (29, 9, 0)),
    (ontology.VEGETATION, (36, 6, -10), (37, 7, -6)),
    (ontology.VEGETATION, (34, 4, -6), (39, 9, -2)),
)


def fill(
    labels: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    class_id: int,
    lower_m: Sequence[float],
    upper_m: Sequence[float],
) -> None:
    """Set the voxels whose center lies in a box of the occ frame."""
    centers = grid.centers().numpy()
    labels[((centers >= lower_m) & (centers < upper_m)).all(axis=-1)] = class_id


def labels_of(*boxes: tuple, grid: VoxelGrid = GRID) -> UInt8[np.ndarray, "X Y Z"]:
    """Free space with some boxes in it: of each the class, and the lower and upper corner."""
    labels = np.full(grid.shape, FREE, dtype=np.uint8)
    for class_id, lower_m, upper_m in boxes:
        fill(labels, grid, class_id, lower_m, upper_m)
    return labels


def pixels_of(image: UInt8[np.ndarray, "h w 3"], color: Sequence[float]) -> np.ndarray:
    """Row and column of the pixels of a color's hue, which light and haze change little."""
    rgb = image.reshape(-1, 3).astype(np.float32)
    hue, wanted = (c - c.min(axis=-1, keepdims=True) for c in (rgb, np.asarray(color, np.float32)))
    strength = np.linalg.norm(hue, axis=-1)
    alike = hue @ wanted > 0.985 * strength * np.linalg.norm(wanted)
    return np.argwhere((alike & (strength > 60)).reshape(image.shape[:2]))


def tilted_frustum(roll_rad: float, pitch_rad: float) -> Frustum:
    """A 90-degree camera on a UAV with some tilt."""
    rotation = geometry.rotation_from_euler(*torch.tensor([roll_rad, pitch_rad, 0.0]).double())
    world_from_body = geometry.rigid(rotation, torch.zeros(3).double())
    mount = geometry.front_mount((0.2, 0.0, 0.0), math.radians(15))
    chain = geometry.camera_from_occ(world_from_body, mount)
    return Frustum(chain, geometry.pinhole(WIDTH, HEIGHT, math.radians(90)), (WIDTH, HEIGHT))


def street(grid: VoxelGrid = GRID, frustum: Frustum | None = None) -> UInt8[np.ndarray, "X Y Z"]:
    """Buildings left and right of a road with everything on it; unknown outside the frustum."""
    labels = labels_of(*BOXES, grid=grid)
    if frustum is not None:
        projected = frustum.project(grid.centers(torch.float64).reshape(-1, 3))
        seen = geometry.in_image(*projected, *frustum.size_pix)
        labels[~seen.reshape(grid.shape).numpy()] = UNKNOWN
    return labels


def scene_of(grid: VoxelGrid, **changes: object) -> VoxelScene:
    """A street, its labels seen by a tilted camera, and two predictions that err differently."""
    frustum, noisy = tilted_frustum(0.2, 0.1), street(grid)
    noisy[np.random.default_rng(1).random(grid.shape) < 0.01] = CAR
    predictions = {"baseline": np.roll(street(grid), 2, axis=1), "skyocc": noisy}
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    scene = {"title": "downtown-03 frame 41", "grid": grid, "image": image}
    scene |= {"truth": street(grid, frustum), "predictions": predictions, "frustum": frustum}
    return VoxelScene(**scene | changes)
