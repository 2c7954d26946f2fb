"""A scene as the front camera sees it: colour, depth, classes and instances of every pixel."""

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
from .camera import (
    FAR_M,
    NEAR_M,
    SAMPLE_OFFSET_PIX,
    depth_from_buffer,
    frustum_planes,
    in_view,
    projection_matrix,
    view_matrix,
)
from .drawing import Drawing, texture_coordinates
from .lighting import cast_shadows, illuminate
from .mesh import Mesh, merge, split
from .renderer import require_renderer
from .scene import Part, Scene
from .weather import Weather

CELL_M = 25.0
"""The static scene is drawn as cells of this side, so that what is out of sight can be hidden."""

STATIC = -1
"""In place of an actor's index: what never moves."""


@dataclass(frozen=True)
class Rendering:
    """One frame of the front camera, sampled at pixel centres. Depth is z-depth, inf at the sky.

    The sky is white. ``class_id`` is 255 there; ``actor_id`` is 0 on static things and -1 at the
    sky.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    class_id: UInt8[np.ndarray, "h w"]
    actor_id: Int[np.ndarray, "h w"]


class World:
    """Shows one scene through one camera. Use it as a context manager.

    TinyRenderer ("tiny") gives lit colour, depth and instances. EGL ("egl") gives the bare colour
    alone: its depth may have 16 bits only, so that depth and instances are of rays through the
    pixels' centres, and it cannot be told a weather's light. Shadows are of rays with both.

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
        self._scene = scene
        self._near_m, self._far_m = depth_range_m
        self._size = (width, height)
        self._renderer = renderer
        self._projection = projection_matrix(
            pix_from_camera, width, height, *depth_range_m, SAMPLE_OFFSET_PIX[renderer]
        )
        self._planes = frustum_planes(pix_from_camera, width, height)
        pix = pixel_centers(width, height).reshape(-1, 2)
        one_m = torch.ones(len(pix), dtype=pix.dtype)
        through = unproject(pix, one_m, pix_from_camera).numpy().astype(np.float32)
        self._through = through.reshape(height, width, 3)
        """Of every pixel, the place in the camera's frame that it shows at a depth of 1 m."""

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
        """The scene as it is at a step, lit by the weather; what the air does comes later."""
        camera_from_world = inverse(world_from_camera)
        self._place(step, camera_from_world.numpy())
        rgb, buffer, body = self._drawing.picture(
            *self._size,
            view_matrix(camera_from_world),
            self._projection,
            {**weather.light(), "shadow": 0},
        )
        if self._renderer == "tiny":
            rendering = self._sensed(rgb, buffer, body)
            if not weather.shadow:
                return rendering
            relight = cast_shadows
        else:
            rendering = self._cast(rgb, step, world_from_camera.numpy())
            relight = illuminate
        points_m = self._points_m(rendering.depth_m, world_from_camera.numpy())
        blocked = partial(self._scene.blocked, step)
        lit = relight(rendering.rgb, points_m, rendering.depth_m, weather, blocked)
        return replace(rendering, rgb=lit)

    def _fill(self) -> None:
        """Draws the scene, and keeps what is to be known of each of the drawing's bodies."""
        self._bodies: list[_Body] = []
        # EGL hides on its own what is out of sight, and pays for every body.
        cell_m = CELL_M if self._renderer == "tiny" else np.inf
        self._add(self._scene.static, STATIC, cell_m)
        for index, actor in enumerate(self._scene.bodies):
            self._add(actor.parts, index, np.inf)
        actor_ids = np.array([*(actor.actor_id for actor in self._scene.bodies), 0])
        self._actor = np.array([body.actor for body in self._bodies], dtype=int)
        self._actor_id = actor_ids[self._actor]
        self._class_id = np.array([body.class_id for body in self._bodies])
        self._middle_m = np.array([body.middle_m for body in self._bodies]).reshape(-1, 3)
        self._reach_m = np.array([body.reach_m for body in self._bodies])
        self._shown = np.ones(len(self._bodies), dtype=bool)

    def _sensed(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        buffer: Float[np.ndarray, "h w"],
        body: Int[np.ndarray, "h w"],
    ) -> Rendering:
        """What the renderer itself says of every pixel."""
        depth_m = depth_from_buffer(buffer, self._near_m, self._far_m)
        # A body that the far plane cuts off leaves its number in the mask, but no depth.
        sky = (body < 0) | np.isinf(depth_m)
        return _rendering(rgb, depth_m, self._class_id[body], self._actor_id[body], sky)

    def _cast(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        step: int,
        world_from_camera: Float[np.ndarray, "4 4"],
    ) -> Rendering:
        """The same from rays."""
        shape = rgb.shape[:2]
        length = np.linalg.norm(self._through, axis=-1)
        directions = rotate(world_from_camera, self._through / length[..., None])
        origins_m = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
        hits = self._scene.cast(step, origins_m.reshape(-1, 3), directions.reshape(-1, 3))
        depth_m = hits.distance_m.reshape(shape) / length
        sky = ~(depth_m < self._far_m)
        return _rendering(
            rgb, depth_m, hits.class_id.reshape(shape), hits.actor_id.reshape(shape), sky
        )

    def _points_m(
        self, depth_m: Float[np.ndarray, "h w"], world_from_camera: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "h w 3"]:
        """Where in the world each pixel looks; at the sky, the camera's own place."""
        world_from_camera = world_from_camera.astype(np.float32)
        finite_m = np.where(np.isfinite(depth_m), depth_m, 0)
        return transform(world_from_camera, finite_m[..., None] * self._through)

    def _place(self, step: int, camera_from_world: Float[np.ndarray, "4 4"]) -> None:
        """Shows what can be seen, where it is at the step, and hides the rest."""
        moved = [actor.world_from_actor[step] for actor in self._scene.bodies]
        world_from_actor = np.stack([*moved, np.eye(4)])[self._actor]
        middle_m = np.einsum("nij,nj->ni", world_from_actor[:, :3, :3], self._middle_m)
        middle_m += world_from_actor[:, :3, 3]
        sphere_m = middle_m, self._reach_m
        seen = in_view(self._planes, camera_from_world, *sphere_m, self._far_m)
        for body in np.flatnonzero(seen != self._shown).tolist():
            self._drawing.show(body, bool(seen[body]))
        self._shown = seen
        for body in np.flatnonzero(seen & (self._actor != STATIC)).tolist():
            self._drawing.place(body, world_from_actor[body])

    def _add(self, parts: Iterable[Part], actor: int, cell_m: float) -> None:
        """One body of the drawing for each class, texture and cell."""
        grouped: dict[tuple, list[tuple[Mesh, np.ndarray]]] = defaultdict(list)
        for part in parts:
            for cell, mesh in split(part.mesh, cell_m).items():
                texture, uvs = texture_coordinates(replace(part, mesh=mesh))
                grouped[part.class_id, texture, cell].append((mesh, uvs))
        for (class_id, texture, _), members in grouped.items():
            mesh = merge([mesh for mesh, _ in members])
            self._drawing.add(mesh, np.concatenate([uvs for _, uvs in members]), texture)
            self._bodies.append(_Body(class_id, actor, *mesh.bounding_sphere()))


@dataclass(frozen=True)
class _Body:
    """What the drawing's body of the same number is: its class, whose it is, a sphere around it."""

    class_id: int
    actor: int
    middle_m: Float[np.ndarray, "3"]
    reach_m: float


def _rendering(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float[np.ndarray, "h w"],
    class_id: Int[np.ndarray, "h w"],
    actor_id: Int[np.ndarray, "h w"],
    sky: Bool[np.ndarray, "h w"],
) -> Rendering:
    return Rendering(
        np.where(sky[..., None], np.uint8(255), rgb),
        np.where(sky, np.inf, depth_m).astype(np.float32),
        np.where(sky, SKY, class_id).astype(np.uint8),
        np.where(sky, -1, actor_id).astype(np.int32),
    )
