"""The one bullet client: draws a scene and returns the camera's colour, depth and instances."""

import os
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image
from torch import Tensor

from ..errors import UserError
from ..geometry import inverse
from ..ontology import SKY
from .camera import (
    FAR_M,
    NEAR_M,
    SAMPLE_OFFSET_PIX,
    depth_from_buffer,
    projection_matrix,
    view_matrix,
)
from .mesh import Mesh, merge
from .scene import Part, Scene
from .textures import PALETTE, TEXTURES
from .weather import Weather

PALETTE_SIDE = 16
CELL_PIX = 4


@dataclass(frozen=True)
class Rendering:
    """One frame of the front camera, sampled at pixel centres. Depth is z-depth, inf at the sky.

    ``class_id`` is 255 at the sky; ``actor_id`` is 0 on static things and -1 at the sky.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    class_id: UInt8[np.ndarray, "h w"]
    actor_id: Int[np.ndarray, "h w"]


class World:
    """A bullet world that shows one scene. Use it as a context manager.

    Raises `UserError` where pybullet is not installed or was built without numpy.
    """

    def __init__(
        self, scene: Scene, pix_from_camera: Float[Tensor, "3 3"], width: int, height: int
    ) -> None:
        self._bullet = import_bullet()
        self._scene = scene
        self._size = (width, height)
        self._projection = projection_matrix(
            pix_from_camera, width, height, NEAR_M, FAR_M, SAMPLE_OFFSET_PIX["tiny"]
        )

    def __enter__(self) -> "World":
        self._client = self._bullet.connect(self._bullet.DIRECT)
        self._textures: dict[str, int] = {}
        self._class_of: list[int] = []
        self._actor_of: list[int] = []
        self._handles: dict[int, list[int]] = {}
        with tempfile.TemporaryDirectory() as folder:
            self._folder = Path(folder)
            self._add(self._scene.static, actor_id=0)
            for body in self._scene.bodies:
                self._handles[body.actor_id] = self._add(body.parts, body.actor_id)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bullet.disconnect(self._client)

    def render(
        self, step: int, world_from_camera: Float[Tensor, "4 4"], weather: Weather
    ) -> Rendering:
        """The scene as it is at a step, lit by the weather; what the air does comes later."""
        self._place_actors(step)
        width, height = self._size
        _, _, rgba, buffer, mask = self._bullet.getCameraImage(
            width,
            height,
            view_matrix(inverse(world_from_camera)),
            self._projection,
            renderer=self._bullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
            **weather.light(),
        )
        body = np.asarray(mask, dtype=np.int64).reshape(height, width)
        depth_m = depth_from_buffer(np.asarray(buffer).reshape(height, width), NEAR_M, FAR_M)
        # A body that the far plane cuts off leaves its number in the mask, but no depth.
        sky = (body < 0) | np.isinf(depth_m)
        return Rendering(
            np.asarray(rgba, dtype=np.uint8).reshape(height, width, 4)[..., :3],
            np.where(sky, np.float32(np.inf), depth_m).astype(np.float32),
            np.where(sky, SKY, np.array(self._class_of)[body]).astype(np.uint8),
            np.where(sky, -1, np.array(self._actor_of)[body]).astype(np.int32),
        )

    def _place_actors(self, step: int) -> None:
        for body in self._scene.bodies:
            pose = body.world_from_actor[step]
            yaw_rad = np.arctan2(pose[1, 0], pose[0, 0])
            quat_xyzw = [0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)]
            for handle in self._handles[body.actor_id]:
                self._bullet.resetBasePositionAndOrientation(
                    handle, pose[:3, 3].tolist(), quat_xyzw, physicsClientId=self._client
                )

    def _add(self, parts: Iterable[Part], actor_id: int) -> list[int]:
        """One bullet body for each class and texture; bullet numbers bodies from 0 upwards."""
        grouped: dict[tuple[int, str], list[tuple[Mesh, np.ndarray]]] = defaultdict(list)
        for part in parts:
            texture, uvs = texture_coordinates(part)
            grouped[part.class_id, texture].append((part.mesh, uvs))
        handles = []
        for (class_id, texture), members in grouped.items():
            mesh = merge([mesh for mesh, _ in members])
            handles.append(self._draw(mesh, np.concatenate([uvs for _, uvs in members]), texture))
            self._class_of.append(class_id)
            self._actor_of.append(actor_id)
        return handles

    def _draw(self, mesh: Mesh, uvs: Float[np.ndarray, "v 2"], texture: str) -> int:
        bullet, client = self._bullet, self._client
        shape = bullet.createVisualShape(
            bullet.GEOM_MESH,
            vertices=mesh.vertices_m.tolist(),
            indices=mesh.faces.reshape(-1).tolist(),
            uvs=uvs.tolist(),
            normals=mesh.normals.tolist(),
            rgbaColor=[1, 1, 1, 1],
            physicsClientId=client,
        )
        handle = bullet.createMultiBody(0, -1, shape, physicsClientId=client)
        image = self._texture(texture)
        bullet.changeVisualShape(handle, -1, textureUniqueId=image, physicsClientId=client)
        return handle

    def _texture(self, name: str) -> int:
        if name not in self._textures:
            path = self._folder / f"{len(self._textures)}.png"
            Image.fromarray(_texture_image(name)).save(path)
            self._textures[name] = self._bullet.loadTexture(str(path), physicsClientId=self._client)
        return self._textures[name]


def texture_coordinates(part: Part) -> tuple[str, Float[np.ndarray, "v 2"]]:
    """The texture of a part and where its vertices lie in it; plain colours share the palette."""
    if part.material in TEXTURES:
        return part.material, part.mesh.uvs_m / np.array(TEXTURES[part.material].tile_m)
    row, column = divmod(PALETTE.index(part.material), PALETTE_SIDE)
    uv = (np.array([column, row]) + 0.5) / PALETTE_SIDE
    return "palette", np.broadcast_to(uv, part.mesh.uvs_m.shape)


def _texture_image(name: str) -> UInt8[np.ndarray, "h w 3"]:
    if name != "palette":
        # Bullet reads images top row first and v upwards: row 0 of a texture is its top.
        return TEXTURES[name].draw()
    cells = np.zeros((PALETTE_SIDE**2, 3), dtype=np.uint8)
    cells[: len(PALETTE)] = [[int(color[k : k + 2], 16) for k in (1, 3, 5)] for color in PALETTE]
    image = cells.reshape(PALETTE_SIDE, PALETTE_SIDE, 3)
    return np.flipud(image.repeat(CELL_PIX, axis=0).repeat(CELL_PIX, axis=1)).copy()


def import_bullet():
    """The pybullet module; its wheels stop at Python 3.11, and training does not need it."""
    try:
        with _silent_stderr():
            import pybullet
    except ImportError as error:
        raise UserError(
            "pybullet is not installed, and generating data needs it: use Python 3.10 or 3.11 and "
            "`pip install pybullet`, or point paths.dataset at a finished data set"
        ) from error
    if not pybullet.isNumpyEnabled():
        raise UserError("pybullet was built without numpy: reinstall it with numpy present")
    return pybullet


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Bullet's C code prints its build time on import; standard error is for what goes wrong."""
    kept = os.dup(2)
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
