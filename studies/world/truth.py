"""What a scene truly holds and shows at one frame, from its geometry alone.

The scene is what is drawn: triangles. Their areas in the voxels are exact; what of them is visible
is found by rays through many places of every pixel, not through the annotator's images or masks.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from src.geometry import (
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
from src.ontology import OCCUPIED
from src.sim.scene import Scene
from studies.world.surfaces import surface_areas

# A class is truly in a voxel when its surface there exceeds this share of a voxel's face.
FACE_SHARE = 0.01

# A label is a phantom only where no surface of its class is within this distance of its voxel.
TOLERANCE_M = 1e-3

# Every pixel has 4 x 4 rays, evenly spread: thin structures are narrower than a pixel.
RAYS_A_SIDE = 4

# For each voxel, by class.
OfClasses = Bool[np.ndarray, "X Y Z 8"]
Matrix = Float[np.ndarray, "4 4"]


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
        """The camera's center in the world."""
        return (self.world_from_body @ self.body_from_camera)[:3, 3].numpy()


@dataclass(frozen=True)
class SurfaceTruth:
    """The surfaces of one frame: which classes each voxel holds, which come within 1 mm of it,
    which of its surfaces the camera sees, whether it sees as far as the voxel's center, and whether
    that center is in the image."""

    holds: OfClasses
    touches: OfClasses
    seen: OfClasses
    center_seen: Bool[np.ndarray, "X Y Z"]
    inside: Bool[np.ndarray, "X Y Z"]

    @classmethod
    def of(cls, scene: Scene, step: int, camera: Camera, grid: VoxelGrid) -> "SurfaceTruth":
        """Looks at the scene as it is at a step of the simulation."""
        occ_from_world = inverse(world_from_occ(camera.world_from_body)).numpy()
        triangles_m, class_id = scene.triangles_at(step)
        triangles_occ = transform(occ_from_world, triangles_m)

        areas_m2 = surface_areas(triangles_occ, class_id, grid)
        near_m2 = surface_areas(triangles_occ, class_id, grid, TOLERANCE_M)
        seen = seen_surfaces(scene, step, camera, grid, occ_from_world)
        center_seen, inside = seen_centers(scene, step, camera, grid)
        return cls(areas_m2 > FACE_SHARE * grid.voxel_m**2, near_m2 > 0, seen, center_seen, inside)


def seen_surfaces(
    scene: Scene, step: int, camera: Camera, grid: VoxelGrid, occ_from_world: Matrix
) -> OfClasses:
    """Returns the classes in every voxel that some of the camera's rays meet first."""
    directions = rays_of(camera)
    hits = scene.cast(step, np.broadcast_to(camera.place_m, directions.shape), directions)
    met = hits.actor_id >= 0
    points_m = camera.place_m + directions[met] * hits.distance_m[met, None].astype(np.float64)
    points_occ = transform(occ_from_world, points_m)
    index, within = grid.index_of(torch.from_numpy(points_occ))
    seen = np.zeros((*grid.shape, len(OCCUPIED)), dtype=bool)
    seen[(*index[within].numpy().T, hits.class_id[met][within.numpy()])] = True
    return seen


def rays_of(camera: Camera) -> Float[np.ndarray, "n 3"]:
    """Returns unit directions in the world through `RAYS_A_SIDE` squared places of every pixel."""
    u, v = (
        (torch.arange(side * RAYS_A_SIDE, dtype=torch.float64) + 0.5) / RAYS_A_SIDE
        for side in (camera.width, camera.height)
    )
    pix = torch.cartesian_prod(u, v)
    through = unproject(pix, torch.ones(len(pix), dtype=pix.dtype), camera.pix_from_camera)

    through = through / through.norm(dim=-1, keepdim=True)
    world_from_camera = camera.world_from_body @ camera.body_from_camera
    return rotate(world_from_camera, through).numpy()


def seen_centers(
    scene: Scene, step: int, camera: Camera, grid: VoxelGrid
) -> tuple[Bool[np.ndarray, "X Y Z"], Bool[np.ndarray, "X Y Z"]]:
    """Returns the voxels to whose center the camera has a clear line of sight, and those in the
    image."""
    centers = grid.centers(torch.float64).reshape(-1, 3)
    chain = camera_from_occ(camera.world_from_body, camera.body_from_camera)
    pix, depth_m = project(centers, chain, camera.pix_from_camera)
    inside = in_image(pix, depth_m, camera.width, camera.height).numpy()

    # A center is seen where the ray towards it meets nothing before it.
    centers_m = transform(world_from_occ(camera.world_from_body), centers).numpy()
    away_m = centers_m[inside] - camera.place_m
    distance_m = np.linalg.norm(away_m, axis=1)
    origins_m = np.broadcast_to(camera.place_m, away_m.shape)
    hits = scene.cast(step, origins_m, away_m / distance_m[:, None])
    seen = np.zeros(len(centers), dtype=bool)
    seen[inside] = hits.distance_m > distance_m
    return seen.reshape(grid.shape), inside.reshape(grid.shape)
