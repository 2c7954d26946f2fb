"""What one clip contains: the town near the route and the actors that move through it."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import transform
from ..ontology import GROUND, UNKNOWN
from .layout import GroundPatch, Town
from .mesh import Mesh, merge, mesh_of_patch, mesh_of_solid
from .rays import RayScene
from .solid import Solid

PATCH_M = 40.0
"""Longer ground patches are cut, so that only what is near a route is drawn."""


@dataclass(frozen=True)
class Part:
    """Everything of one class and one material, as one mesh."""

    class_id: int
    material: str
    mesh: Mesh


@dataclass(frozen=True)
class Body:
    """A moving actor: its parts in its own frame, and where it is at every step."""

    actor_id: int
    type: str
    class_id: int
    size_m: tuple[float, float, float]
    parts: tuple[Part, ...]
    world_from_actor: Float[np.ndarray, "t 4 4"]
    velocity_mps: Float[np.ndarray, "t 3"]

    @cached_property
    def triangles_m(self) -> Float[np.ndarray, "f 3 3"]:
        return _triangles(self.parts)


@dataclass(frozen=True)
class Hits:
    """What rays met (static things: actor 0), or did not: distance inf, class 255, actor -1."""

    distance_m: Float[np.ndarray, "n"]
    class_id: UInt8[np.ndarray, "n"]
    actor_id: Int[np.ndarray, "n"]

    def part(self, rays: slice) -> "Hits":
        return Hits(self.distance_m[rays], self.class_id[rays], self.actor_id[rays])

    def within(self, range_m: float) -> "Hits":
        """What lies farther away than the range counts as nothing."""
        near = self.distance_m <= range_m
        return Hits(
            np.where(near, self.distance_m, np.inf),
            np.where(near, self.class_id, UNKNOWN).astype(np.uint8),
            np.where(near, self.actor_id, -1),
        )


@dataclass(frozen=True)
class Scene:
    """The static parts and the actors of a clip, ready to be drawn and to be hit by rays."""

    static: tuple[Part, ...]
    bodies: tuple[Body, ...]

    @cached_property
    def _static_rays(self) -> RayScene:
        return RayScene(_triangles(self.static))

    @cached_property
    def _static_classes(self) -> UInt8[np.ndarray, "f"]:
        """The class of every triangle, and at the end, where index -1 leads, that of nothing."""
        classes = [np.full(len(part.mesh.faces), part.class_id, np.uint8) for part in self.static]
        return np.concatenate([*classes, np.array([UNKNOWN], np.uint8)])

    def cast_static(
        self, origins_m: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n"]:
        """Distances in metres to the static scene alone, inf where nothing is hit."""
        return self._static_rays.cast(origins_m, directions)[0]

    def cast(
        self,
        step: int,
        origins_m: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
    ) -> Hits:
        """The first hit of every ray with the scene as it is at a step."""
        distance_m, face = self._static_rays.cast(origins_m, directions)
        class_id = self._static_classes[face]
        actor_id = np.where(face >= 0, 0, -1)
        if self.bodies:
            moved = [_moved(body.triangles_m, body.world_from_actor[step]) for body in self.bodies]
            near_m, face = RayScene(np.concatenate(moved)).cast(origins_m, directions)
            first = near_m < distance_m
            owner = np.repeat(np.arange(len(moved)), [len(triangles) for triangles in moved])
            body_of = owner[face[first]]
            distance_m = np.minimum(distance_m, near_m)
            class_id[first] = np.array([body.class_id for body in self.bodies])[body_of]
            actor_id[first] = np.array([body.actor_id for body in self.bodies])[body_of]
        return Hits(distance_m, class_id, actor_id)

    def blocked(
        self,
        step: int,
        points_m: Float[np.ndarray, "n 3"],
        towards: Float[np.ndarray, "3"],
    ) -> Bool[np.ndarray, "n"]:
        """Whether anything lies between points and a light infinitely far away, above the horizon,
        with the scene as it is at a step. ``towards`` is the unit vector to the light."""
        directions = np.broadcast_to(towards, points_m.shape)
        blocked = self._static_rays.blocked(points_m, directions)
        lit = np.flatnonzero(~blocked)
        if not len(lit):
            return blocked
        bounds_m = points_m[lit].min(axis=0), points_m[lit].max(axis=0)
        moved = [
            _moved(body.triangles_m, body.world_from_actor[step])
            for body in self.bodies
            if _may_shade(body, step, bounds_m, towards)
        ]
        if moved:
            actors = RayScene(np.concatenate(moved))
            blocked[lit] = actors.blocked(points_m[lit], directions[lit])
        return blocked


def _may_shade(
    body: Body,
    step: int,
    bounds_m: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    towards: Float[np.ndarray, "3"],
) -> bool:
    """Whether an actor's shadow, down to the lowest point, may reach into the bounds on the map."""
    lower_m, upper_m = bounds_m
    place_m, reach_m = body.world_from_actor[step, :3, 3], float(np.linalg.norm(body.size_m))
    fall_m = max(0.0, place_m[2] + body.size_m[2] - lower_m[2])
    ends_m = np.stack([place_m[:2], place_m[:2] - towards[:2] * (fall_m / towards[2])])
    above = (ends_m.max(axis=0) + reach_m > lower_m[:2]).all()
    below = (ends_m.min(axis=0) - reach_m < upper_m[:2]).all()
    return bool(above and below)


@dataclass(frozen=True)
class Piece:
    """One solid or one piece of ground as a mesh, and the circle around it on the map."""

    class_id: int
    material: str
    mesh: Mesh
    centre_m: Float[np.ndarray, "2"]
    reach_m: float


def pieces_of(town: Town) -> tuple[Piece, ...]:
    """All of a town, tessellated once for all its clips."""
    solids = [
        Piece(
            solid.class_id,
            solid.material,
            mesh_of_solid(solid),
            solid.scene_from_solid[:2, 3],
            float(np.linalg.norm(solid.size_m)) / 2,
        )
        for solid in town.solids
    ]
    ground = [
        Piece(
            GROUND,
            patch.material,
            mesh_of_patch(patch, town.terrain),
            np.array(patch.origin_m),
            float(np.hypot(patch.length_m, patch.width_m)) / 2,
        )
        for whole in town.ground
        for patch in _cut(whole)
    ]
    return (*solids, *ground)


def static_parts(
    pieces: Sequence[Piece], near_m: Float[np.ndarray, "n 2"] | None = None, radius_m: float = 0.0
) -> tuple[Part, ...]:
    """Pieces merged by class and material: all, or those within a radius of any of the places."""
    meshes = defaultdict(list)
    for piece in pieces:
        if near_m is None or _distance_m(piece.centre_m, near_m) < radius_m + piece.reach_m:
            meshes[piece.class_id, piece.material].append(piece.mesh)
    return tuple(Part(*key, merge(meshes[key])) for key in sorted(meshes))


def parts_of(solids: Iterable[Solid]) -> tuple[Part, ...]:
    """An actor's solids, in its own frame, merged by material."""
    meshes = defaultdict(list)
    for solid in solids:
        meshes[solid.class_id, solid.material].append(mesh_of_solid(solid))
    return tuple(Part(*key, merge(meshes[key])) for key in sorted(meshes))


def _distance_m(point_m: Float[np.ndarray, "2"], near_m: Float[np.ndarray, "n 2"]) -> float:
    return float(np.sqrt(((near_m - point_m) ** 2).sum(axis=1).min()))


def _cut(patch: GroundPatch) -> list[GroundPatch]:
    """The patch in pieces of at most PATCH_M a side; its texture starts anew in every piece."""
    nx = max(1, int(np.ceil(patch.length_m / PATCH_M)))
    ny = max(1, int(np.ceil(patch.width_m / PATCH_M)))
    cos, sin = np.cos(patch.yaw_rad), np.sin(patch.yaw_rad)
    pieces = []
    for i in range(nx):
        for j in range(ny):
            along = ((i + 0.5) / nx - 0.5) * patch.length_m
            across = ((j + 0.5) / ny - 0.5) * patch.width_m
            centre_m = (
                patch.origin_m[0] + cos * along - sin * across,
                patch.origin_m[1] + sin * along + cos * across,
            )
            size_m = (patch.length_m / nx, patch.width_m / ny)
            pieces.append(
                GroundPatch(centre_m, patch.yaw_rad, *size_m, patch.rise_m, patch.material)
            )
    return pieces


def _triangles(parts: Iterable[Part]) -> Float[np.ndarray, "f 3 3"]:
    triangles = [part.mesh.vertices_m[part.mesh.faces] for part in parts]
    return np.concatenate(triangles) if triangles else np.zeros((0, 3, 3))


def _moved(
    triangles_m: Float[np.ndarray, "f 3 3"], b_from_a: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "f 3 3"]:
    return transform(b_from_a, triangles_m)
