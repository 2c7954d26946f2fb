"""A scene as the front camera sees it: color, depth, class and instance of every pixel."""

from collections import defaultdict
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from ..geometry import inverse, pixel_centers, rotate, transform, unproject
from ..ontology import SKY
from . import camera
from .camera import FAR_M, NEAR_M, SAMPLE_OFFSET_PIX
from .drawing import Drawing, texture_coordinates
from .lighting import Depths, Picture, Places, cast_shadows, illuminate
from .mesh import Mesh, merge, split
from .renderer import require_renderer
from .scene import Part, Scene
from .weather import Weather

Matrix = Float[np.ndarray, "4 4"]

# The static scene is drawn as cells of this side, so that what is out of sight can be hidden.
CELL_M = 25.0

# Stands for an actor's index where a mesh belongs to no actor. It leads to the last row of tables
# that hold the actors first and the static scene at their end.
STATIC = -1


@dataclass(frozen=True)
class Rendering:
    """One frame of the front camera, sampled at pixel centers. Depth is z-depth, inf at the sky.

    The sky is white. ``class_id`` is 255 there; ``actor_id`` is 0 on static things and -1 at the
    sky.
    """

    rgb: Picture
    depth_m: Depths
    class_id: UInt8[np.ndarray, "h w"]
    actor_id: Int[np.ndarray, "h w"]

    def with_sky(self, sky: Bool[np.ndarray, "h w"]) -> "Rendering":
        """Returns the rendering, in its own dtypes, with these pixels as sky."""
        return Rendering(
            rgb=np.where(sky[..., None], np.uint8(255), self.rgb),
            depth_m=np.where(sky, np.inf, self.depth_m).astype(np.float32),
            class_id=np.where(sky, SKY, self.class_id).astype(np.uint8),
            actor_id=np.where(sky, -1, self.actor_id).astype(np.int32),
        )


class World:
    """Shows one scene through one camera. Use it as a context manager.

    TinyRenderer ("tiny") gives lit color, depth and instances. EGL ("egl") gives the bare color
    alone: its depth may have 16 bits only, so that depth and instances are of rays through the
    pixels' centers, and it cannot be given a weather's light. Shadows are of rays with both.

    Nothing nearer or farther than ``depth_range_m`` is shown. Raises `UserError` where this machine
    cannot run the renderer.
    """

    def __init__(
        self,
        scene: Scene,
        pix_from_camera: Float[Tensor, "3 3"],
        width: int,
        height: int,
        renderer: str = "tiny",
        depth_range_m: tuple[float, float] = (NEAR_M, FAR_M),
    ) -> None:
        require_renderer(renderer)
        self._scene, self._renderer, self._size = scene, renderer, (width, height)
        self._near_m, self._far_m = depth_range_m
        self._projection = camera.projection_matrix(
            pix_from_camera, width, height, *depth_range_m, SAMPLE_OFFSET_PIX[renderer]
        )
        self._planes = camera.frustum_planes(pix_from_camera, width, height)

        # Where, in the camera's frame, every pixel looks at a depth of 1 m.
        pix = pixel_centers(width, height)
        through = unproject(pix, torch.ones_like(pix[..., 0]), pix_from_camera)
        self._through = through.numpy().astype(np.float32)

    def __enter__(self) -> "World":
        self._drawing = Drawing(self._renderer)
        with ExitStack() as undo:
            undo.callback(self._drawing.close)
            self._fill()
            undo.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._drawing.close()

    def render(
        self, step: int, world_from_camera: Float[Tensor, "4 4"], weather: Weather
    ) -> Rendering:
        """Returns the scene as it is at a step, lit by the weather; `air` adds fog and rain."""
        camera_from_world = inverse(world_from_camera)
        self._place(step, camera_from_world.numpy())
        matrices = camera.view_matrix(camera_from_world), self._projection
        rgb, buffer, bullet_id = self._drawing.picture(*self._size, *matrices, weather.light())

        if self._renderer == "tiny":
            relight = cast_shadows
            rendering = self._from_buffers(rgb, buffer, bullet_id)
            if not weather.shadow:
                return rendering
        else:
            relight = illuminate
            rendering = self._from_rays(rgb, step, world_from_camera.numpy())

        points_m = self._points_m(rendering.depth_m, world_from_camera.numpy())
        blocked = partial(self._scene.blocked, step)
        lit = relight(rendering.rgb, points_m, rendering.depth_m, weather, blocked)
        return replace(rendering, rgb=lit)

    def _fill(self) -> None:
        """Draws the scene, and keeps one row a mesh of the drawing, in the order of bullet ids."""
        # Class, index of the actor, and the middle and radius of a sphere around the mesh.
        self._drawn: list[tuple[int, int, np.ndarray, float]] = []
        # EGL hides on its own what is out of sight, and pays for every mesh.
        self._add(self._scene.static, STATIC, CELL_M if self._renderer == "tiny" else np.inf)
        for index, actor in enumerate(self._scene.actors):
            self._add(actor.parts, index, np.inf)

        columns = zip(*self._drawn) if self._drawn else ([], np.zeros(0, int), np.zeros((0, 3)), [])
        self._class_id, self._actor, self._middle_m, self._reach_m = map(np.array, columns)
        actor_ids = np.array([*(actor.actor_id for actor in self._scene.actors), 0])
        self._actor_id = actor_ids[self._actor]
        self._visible = np.ones(len(self._drawn), dtype=bool)

    def _add(self, parts: Iterable[Part], actor: int, cell_m: float) -> None:
        """Draws one mesh for each class, texture and cell."""
        grouped: dict[tuple, list[tuple[Mesh, np.ndarray]]] = defaultdict(list)
        for part in parts:
            for cell, mesh in split(part.mesh, cell_m).items():
                texture, uvs = texture_coordinates(replace(part, mesh=mesh))
                grouped[part.class_id, texture, cell].append((mesh, uvs))

        for (class_id, texture, _), members in grouped.items():
            mesh = merge([mesh for mesh, _ in members])
            self._drawing.add(mesh, np.concatenate([uvs for _, uvs in members]), texture)
            self._drawn.append((class_id, actor, *mesh.bounding_sphere()))

    def _place(self, step: int, camera_from_world: Matrix) -> None:
        """Shows every mesh that can be seen, where it is at the step, and hides the rest."""
        moved = [actor.world_from_actor[step] for actor in self._scene.actors]
        world_from_mesh = np.stack([*moved, np.eye(4)])[self._actor]
        middle_m = transform(world_from_mesh, self._middle_m[:, None])[:, 0]

        seen = camera.in_view(self._planes, camera_from_world, middle_m, self._reach_m, self._far_m)
        for bullet_id in np.flatnonzero(seen != self._visible).tolist():
            self._drawing.show(bullet_id, bool(seen[bullet_id]))
        self._visible = seen
        for bullet_id in np.flatnonzero(seen & (self._actor != STATIC)).tolist():
            self._drawing.place(bullet_id, world_from_mesh[bullet_id])

    def _from_buffers(
        self, rgb: Picture, buffer: Depths, bullet_id: Int[np.ndarray, "h w"]
    ) -> Rendering:
        """Reads depth, class and actor of every pixel from the renderer's own buffers."""
        depth_m = camera.depth_from_buffer(buffer, self._near_m, self._far_m)
        # A mesh that the far plane cuts off leaves its number in the mask, but no depth.
        sky = (bullet_id < 0) | np.isinf(depth_m)
        class_id, actor_id = self._class_id[bullet_id], self._actor_id[bullet_id]
        return Rendering(rgb, depth_m, class_id, actor_id).with_sky(sky)

    def _from_rays(self, rgb: Picture, step: int, world_from_camera: Matrix) -> Rendering:
        """Finds depth, class and actor of every pixel by a ray through its center."""
        shape = rgb.shape[:2]
        length = np.linalg.norm(self._through, axis=-1)
        directions = rotate(world_from_camera, self._through / length[..., None])
        origins_m = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
        hits = self._scene.cast(step, origins_m.reshape(-1, 3), directions.reshape(-1, 3))

        depth_m = hits.distance_m.reshape(shape) / length
        class_id, actor_id = hits.class_id.reshape(shape), hits.actor_id.reshape(shape)
        return Rendering(rgb, depth_m, class_id, actor_id).with_sky(~(depth_m < self._far_m))

    def _points_m(self, depth_m: Depths, world_from_camera: Matrix) -> Places:
        """Returns where in the world each pixel looks; at the sky, the camera's own position."""
        world_from_camera = world_from_camera.astype(np.float32)
        finite_m = np.where(np.isfinite(depth_m), depth_m, 0)
        return transform(world_from_camera, finite_m[..., None] * self._through)
