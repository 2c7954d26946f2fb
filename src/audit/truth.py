"""What a scene truly holds and shows at one frame, from its geometry alone.

The scene is what is drawn: triangles. Their areas in the voxels are exact; what of them is visible
is found by rays through many places of every pixel, not through the annotator's images or masks.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from ..geometry import (
    VoxelGrid,
    camera_from_occ,
    in_image,
    inverse,
    project,
    rotate,
    transform,
    unproject,
    world_from_occ,
)
from ..ontology import OCCUPIED
from ..sim.scene import Scene
from .surfaces import surface_areas

FACE_SHARE = 0.01
"""A class is truly in a voxel when its surface there exceeds this share of a voxel's face."""

TOLERANCE_M = 1e-3
"""A label is a phantom only where no surface of its class is within this distance of its voxel."""

RAYS_A_SIDE = 4
"""Of every pixel: 4 x 4 rays, evenly spread."""


@dataclass(frozen=True)
class Camera:
    """The front camera at one frame; matrices are float64 tensors."""

    world_from_body: torch.Tensor
    body_from_camera: torch.Tensor
    pix_from_camera: torch.Tensor
    width: int
    height: int

    @property
    def place_m(self) -> Float[np.ndarray, "3"]:
        """The camera's centre in the world."""
        return (self.world_from_body @ self.body_from_camera)[:3, 3].numpy()


@dataclass(frozen=True)
class Truth:
    """Of one frame: which classes each voxel holds, which come within 1 mm of it, which of its
    surfaces the camera sees, whether it sees as far as the voxel's centre, and whether that centre
    is in the image."""

    holds: Bool[np.ndarray, "X Y Z 8"]
    touches: Bool[np.ndarray, "X Y Z 8"]
    seen: Bool[np.ndarray, "X Y Z 8"]
    centre_seen: Bool[np.ndarray, "X Y Z"]
    inside: Bool[np.ndarray, "X Y Z"]

    @classmethod
    def of(cls, scene: Scene, step: int, camera: Camera, grid: VoxelGrid) -> "Truth":
        """The scene as it is at a step of the simulation."""
        occ_from_world = inverse(world_from_occ(camera.world_from_body)).numpy()
        triangles_m, class_id = triangles_of(scene, step)
        triangles_occ = transform(occ_from_world, triangles_m)
        areas_m2 = surface_areas(triangles_occ, class_id, grid)
        near_m2 = surface_areas(triangles_occ, class_id, grid, TOLERANCE_M)
        seen = seen_surfaces(scene, step, camera, grid, occ_from_world)
        centre_seen, inside = seen_centres(scene, step, camera, grid)
        return cls(areas_m2 > FACE_SHARE * grid.voxel_m**2, near_m2 > 0, seen, centre_seen, inside)


def triangles_of(
    scene: Scene, step: int
) -> tuple[Float[np.ndarray, "f 3 3"], UInt8[np.ndarray, "f"]]:
    """All triangles of a scene at a step, in the world (float64), and their classes."""
    static = [part.mesh.vertices_m[part.mesh.faces] for part in scene.static]
    classes = [np.full(len(part.mesh.faces), part.class_id, np.uint8) for part in scene.static]
    for body in scene.bodies:
        pose, triangles_m = body.world_from_actor[step], body.triangles_m.astype(np.float64)
        static.append(transform(pose, triangles_m))
        classes.append(np.full(len(triangles_m), body.class_id, np.uint8))
    none = np.zeros((0, 3, 3)), np.zeros(0, np.uint8)
    return np.concatenate([none[0], *static]), np.concatenate([none[1], *classes])


def seen_surfaces(
    scene: Scene,
    step: int,
    camera: Camera,
    grid: VoxelGrid,
    occ_from_world: Float[np.ndarray, "4 4"],
) -> Bool[np.ndarray, "X Y Z 8"]:
    """The classes in every voxel that some of the camera's rays meet first."""
    directions = rays_of(camera)
    origins_m = np.broadcast_to(camera.place_m, directions.shape)
    hits = scene.cast(step, origins_m, directions)
    met = hits.actor_id >= 0
    points_m = camera.place_m + directions[met] * hits.distance_m[met, None].astype(np.float64)
    points_occ = transform(occ_from_world, points_m)
    index, within = grid.index_of(torch.from_numpy(points_occ))
    seen = np.zeros((*grid.shape, len(OCCUPIED)), dtype=bool)
    within = within.numpy()
    seen[(*index.numpy()[within].T, hits.class_id[met][within])] = True
    return seen


def rays_of(camera: Camera) -> Float[np.ndarray, "n 3"]:
    """Unit directions in the world through `RAYS_A_SIDE` squared places of every pixel."""
    u, v = (
        (torch.arange(side * RAYS_A_SIDE, dtype=torch.float64) + 0.5) / RAYS_A_SIDE
        for side in (camera.width, camera.height)
    )
    pix = torch.cartesian_prod(u, v)
    through = unproject(pix, torch.ones(len(pix), dtype=pix.dtype), camera.pix_from_camera)
    through = through / through.norm(dim=-1, keepdim=True)
    world_from_camera = camera.world_from_body @ camera.body_from_camera
    return rotate(world_from_camera, through).numpy()


def seen_centres(
    scene: Scene, step: int, camera: Camera, grid: VoxelGrid
) -> tuple[Bool[np.ndarray, "X Y Z"], Bool[np.ndarray, "X Y Z"]]:
    """Voxels to whose centre the camera has a clear line of sight, and those in the image."""
    centres = grid.centers(torch.float64).reshape(-1, 3)
    chain = camera_from_occ(camera.world_from_body, camera.body_from_camera)
    pix, depth_m = project(centres, chain, camera.pix_from_camera)
    inside = in_image(pix, depth_m, camera.width, camera.height).numpy()
    centres_m = transform(world_from_occ(camera.world_from_body), centres).numpy()
    away_m = centres_m[inside] - camera.place_m
    distance_m = np.linalg.norm(away_m, axis=1)
    origins_m = np.broadcast_to(camera.place_m, away_m.shape)
    hits = scene.cast(step, origins_m, away_m / distance_m[:, None])
    seen = np.zeros(len(centres), dtype=bool)
    seen[inside] = hits.distance_m > distance_m
    return seen.reshape(grid.shape), inside.reshape(grid.shape)
