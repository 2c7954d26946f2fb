"""The contents of one clip: the town near the route and the actors that move through it."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ..geometry import transform
from ..ontology import GROUND, UNKNOWN
from .assets import upright
from .layout import GroundPatch, Town
from .mesh import Mesh, merge, mesh_of_patch, mesh_of_solid
from .rays import RayScene
from .solid import Solid
from .towns.polyline import Spot

Points = Float[np.ndarray, "n 3"]

# Longer ground patches are cut, so that only what is near a route is drawn.
PATCH_M = 40.0


@dataclass(frozen=True)
class Part:
    """Everything of one class and one material, as one mesh."""

    class_id: int
    material: str
    mesh: Mesh


@dataclass(frozen=True)
class SceneActor:
    """A moving actor: its parts in its own frame, and its place, direction and velocity by step.

    Its origin is on the road or pavement under its middle; z is up, x forward. ``size_m`` is
    length, width and height.
    """

    actor_id: int
    type: str
    class_id: int
    size_m: tuple[float, float, float]
    parts: tuple[Part, ...]
    position_m: Float[np.ndarray, "t 3"]
    yaw_rad: Float[np.ndarray, "t"]
    velocity_mps: Float[np.ndarray, "t 3"]

    @cached_property
    def world_from_actor(self) -> Float[np.ndarray, "t 4 4"]:
        """The transform at every step, of an actor that stands upright on its place."""
        places = zip(self.position_m, self.yaw_rad)
        return np.stack([upright(*position_m, yaw_rad) for position_m, yaw_rad in places])

    @cached_property
    def triangles_m(self) -> Float[np.ndarray, "f 3 3"]:
        return _triangles(self.parts)

    def triangles_at(self, step: int) -> Float[np.ndarray, "f 3 3"]:
        """Returns the actor's triangles in the world, where it is at a step."""
        return transform(self.world_from_actor[step], self.triangles_m)


@dataclass(frozen=True)
class ScanHits:
    """The first surface that each ray met.

    Static things are actor 0. A ray that met nothing has distance inf, class 255 and actor -1.
    """

    distance_m: Float[np.ndarray, "n"]
    class_id: UInt8[np.ndarray, "n"]
    actor_id: Int[np.ndarray, "n"]

    def part(self, rays: slice) -> "ScanHits":
        return ScanHits(self.distance_m[rays], self.class_id[rays], self.actor_id[rays])

    def within(self, range_m: float) -> "ScanHits":
        """Returns the hits in which whatever lies farther away than the range counts as nothing."""
        near = self.distance_m <= range_m
        return ScanHits(
            distance_m=np.where(near, self.distance_m, np.inf),
            class_id=np.where(near, self.class_id, UNKNOWN).astype(np.uint8),
            actor_id=np.where(near, self.actor_id, -1),
        )


def count_by_actor(actor_id: Int[np.ndarray, "*n"]) -> dict[int, int]:
    """Returns how many of these hits, or pixels, are of each moving actor that is among them."""
    ids, counts = np.unique(actor_id[actor_id > 0], return_counts=True)
    return dict(zip(ids.tolist(), counts.tolist()))


@dataclass(frozen=True)
class Scene:
    """The static parts and the actors of a clip, ready to be drawn and to be hit by rays."""

    static: tuple[Part, ...]
    actors: tuple[SceneActor, ...]

    @cached_property
    def _static_rays(self) -> RayScene:
        return RayScene(_triangles(self.static))

    @cached_property
    def _static_classes(self) -> UInt8[np.ndarray, "f"]:
        """The class of every static triangle; index -1, a ray without a hit, gives `UNKNOWN`."""
        classes = [np.full(len(part.mesh.faces), part.class_id, np.uint8) for part in self.static]
        return np.concatenate([*classes, np.array([UNKNOWN], np.uint8)])

    def triangles_at(self, step: int) -> tuple[Float[np.ndarray, "f 3 3"], UInt8[np.ndarray, "f"]]:
        """Returns all triangles at a step, in the world (float64), and their classes."""
        moved = [actor.triangles_at(step) for actor in self.actors]
        classes = [np.full(len(each), actor.class_id) for each, actor in zip(moved, self.actors)]
        class_id = np.concatenate([self._static_classes[:-1], *classes]).astype(np.uint8)
        return np.concatenate([_triangles(self.static), *moved]), class_id

    def cast_static(self, origins_m: Points, directions: Points) -> Float[np.ndarray, "n"]:
        """Returns the distances in metres to the static scene alone, inf where nothing is hit."""
        return self._static_rays.cast(origins_m, directions)[0]

    def cast(self, step: int, origins_m: Points, directions: Points) -> ScanHits:
        """Returns the first hit of every ray with the scene as it is at a step."""
        distance_m, face = self._static_rays.cast(origins_m, directions)
        class_id = self._static_classes[face]
        actor_id = np.where(face >= 0, 0, -1)

        if self.actors:
            # Actors move, so their triangles are put into a ray scene of their own at every step.
            moved = [actor.triangles_at(step) for actor in self.actors]
            near_m, face = RayScene(np.concatenate(moved)).cast(origins_m, directions)
            first = near_m < distance_m
            owner = np.repeat(np.arange(len(moved)), [len(triangles) for triangles in moved])
            index = owner[face[first]]
            distance_m = np.minimum(distance_m, near_m)
            class_id[first] = np.array([actor.class_id for actor in self.actors])[index]
            actor_id[first] = np.array([actor.actor_id for actor in self.actors])[index]

        return ScanHits(distance_m, class_id, actor_id)

    def blocked(
        self, step: int, points_m: Points, towards: Float[np.ndarray, "3"]
    ) -> Bool[np.ndarray, "n"]:
        """Returns whether anything lies between points and the sun or moon, at a step.

        ``towards`` is the unit vector to that light, which is infinitely far away, above the
        horizon.
        """
        directions = np.broadcast_to(towards, points_m.shape)
        blocked = self._static_rays.blocked(points_m, directions)

        lit = np.flatnonzero(~blocked)
        if len(lit) and self.actors:
            rays = RayScene(np.concatenate([actor.triangles_at(step) for actor in self.actors]))
            blocked[lit] = rays.blocked(points_m[lit], directions[lit])
        return blocked


@dataclass(frozen=True)
class Piece(Part):
    """One solid or one piece of ground as a mesh, and the circle around it in the plane."""

    center_m: Float[np.ndarray, "2"]
    reach_m: float


def pieces_of(town: Town) -> tuple[Piece, ...]:
    """Tessellates all of a town, once for all its clips."""
    pieces = []
    for solid in town.solids:
        center_m, reach_m = solid.scene_from_solid[:2, 3], float(np.linalg.norm(solid.size_m)) / 2
        mesh = mesh_of_solid(solid)
        pieces.append(Piece(solid.class_id, solid.material, mesh, center_m, reach_m))

    for patch in (piece for whole in town.ground for piece in _cut(whole)):
        center_m = np.array(patch.origin_m)
        reach_m = float(np.hypot(patch.length_m, patch.width_m)) / 2
        mesh = mesh_of_patch(patch, town.terrain)
        pieces.append(Piece(GROUND, patch.material, mesh, center_m, reach_m))
    return tuple(pieces)


def static_parts(
    pieces: Sequence[Piece], near_m: Float[np.ndarray, "n 2"] | None = None, radius_m: float = 0.0
) -> tuple[Part, ...]:
    """Merges pieces by class and material: all, or those within a radius of any of the places."""
    if near_m is None:
        return _merged(pieces)
    return _merged(
        piece for piece in pieces if _distance_m(piece.center_m, near_m) < radius_m + piece.reach_m
    )


def parts_of(solids: Iterable[Solid]) -> tuple[Part, ...]:
    """Merges an actor's solids, in its own frame, by class and material."""
    return _merged(Part(solid.class_id, solid.material, mesh_of_solid(solid)) for solid in solids)


def _merged(parts: Iterable[Part]) -> tuple[Part, ...]:
    meshes = defaultdict(list)
    for part in parts:
        meshes[part.class_id, part.material].append(part.mesh)
    # A fixed order of the parts keeps the renderer's work, and its pixels, the same.
    return tuple(Part(*key, merge(meshes[key])) for key in sorted(meshes))


def _distance_m(point_m: Float[np.ndarray, "2"], near_m: Float[np.ndarray, "n 2"]) -> float:
    return float(np.sqrt(((near_m - point_m) ** 2).sum(axis=1).min()))


def _cut(patch: GroundPatch) -> list[GroundPatch]:
    """Cuts a patch into pieces of at most PATCH_M a side; each begins the texture anew."""
    rows = max(1, int(np.ceil(patch.length_m / PATCH_M)))
    columns = max(1, int(np.ceil(patch.width_m / PATCH_M)))
    size_m = {"length_m": patch.length_m / rows, "width_m": patch.width_m / columns}
    middle = Spot(*patch.origin_m, patch.yaw_rad)

    pieces = []
    for i, j in np.ndindex(rows, columns):
        along_m = ((i + 0.5) / rows - 0.5) * patch.length_m
        across_m = ((j + 0.5) / columns - 0.5) * patch.width_m
        x_m, y_m, _ = middle.moved(along_m, across_m)
        pieces.append(replace(patch, origin_m=(x_m, y_m), **size_m))
    return pieces


def _triangles(parts: Iterable[Part]) -> Float[np.ndarray, "f 3 3"]:
    triangles = [part.mesh.vertices_m[part.mesh.faces] for part in parts]
    return np.concatenate(triangles) if triangles else np.zeros((0, 3, 3))
