"""The one bullet client: textured meshes that can be moved, hidden and pictured."""

import os
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from .mesh import Mesh
from .renderer import egl_plugin, import_bullet, require_renderer, silent
from .scene import Part
from .textures import PALETTE, TEXTURES

PALETTE_SIDE: Final = 16
CELL_PIX: Final = 4

_UP: Final = (0.0, 0.0, 1.0)


class Drawing:
    """A bullet client of one renderer; see `renderer.RENDERERS`. Bodies are numbered from 0.

    Raises `UserError` where this machine cannot run the renderer, and `RuntimeError` for a second
    drawing with EGL while one is open: closing either would end the process, for they share a
    context of OpenGL.
    """

    _egl_is_open = False

    def __init__(self, renderer: str) -> None:
        require_renderer(renderer)
        if renderer == "egl":
            if Drawing._egl_is_open:
                raise RuntimeError(
                    "a process can draw one world at a time with EGL: close it first"
                )
            Drawing._egl_is_open = True
        self._renderer = renderer
        self._bullet = import_bullet()
        self._textures: dict[str, int] = {}
        self._files = tempfile.TemporaryDirectory()
        with silent():
            self._client = self._bullet.connect(self._bullet.DIRECT)
            if renderer == "egl":
                # Clips are made in parallel already; threads of Mesa's would only compete.
                os.environ.setdefault("LP_NUM_THREADS", "1")
                self._bullet.loadPlugin(
                    egl_plugin(), "_eglRendererPlugin", physicsClientId=self._client
                )

    def close(self) -> None:
        """Bullet forgets everything; nothing can be drawn any more."""
        with silent():
            self._bullet.disconnect(self._client)
        if self._renderer == "egl":
            Drawing._egl_is_open = False
        self._files.cleanup()

    def add(self, mesh: Mesh, uvs: Float[np.ndarray, "v 2"], texture: str) -> int:
        """A new body with a mesh, where its vertices lie in a texture, and that texture's name."""
        bullet, client = self._bullet, self._client
        with silent():
            shape = bullet.createVisualShape(
                bullet.GEOM_MESH,
                rgbaColor=[1, 1, 1, 1],
                physicsClientId=client,
                **self._geometry(mesh, uvs),
            )
            body = bullet.createMultiBody(0, -1, shape, physicsClientId=client)
            image = self._texture(texture)
            bullet.changeVisualShape(body, -1, textureUniqueId=image, physicsClientId=client)
        return body

    def show(self, body: int, shown: bool) -> None:
        """Renderers skip what is wholly transparent before they look at its first triangle."""
        self._bullet.changeVisualShape(
            body, -1, rgbaColor=[1, 1, 1, float(shown)], physicsClientId=self._client
        )

    def place(self, body: int, world_from_actor: Float[np.ndarray, "4 4"]) -> None:
        """Moves a body that stands upright."""
        yaw_rad = np.arctan2(world_from_actor[1, 0], world_from_actor[0, 0])
        quat_xyzw = [0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)]
        self._bullet.resetBasePositionAndOrientation(
            body, world_from_actor[:3, 3].tolist(), quat_xyzw, physicsClientId=self._client
        )

    def picture(
        self, width: int, height: int, view: list[float], projection: list[float], light: dict
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
        """Colour, depth buffer, and the number of the body in every pixel, negative where none is.

        ``light`` is what `weather.Weather.light` gives. EGL gives the colour of the unlit surfaces,
        a coarse depth, and no bodies.
        """
        bullet = self._bullet
        tiny = self._renderer == "tiny"
        if not tiny:
            light = {"lightDirection": list(_UP), "shadow": 0}
        # EGL's first picture reports on OpenGL.
        with nullcontext() if tiny else silent():
            _, _, rgba, buffer, body = bullet.getCameraImage(
                width,
                height,
                view,
                projection,
                renderer=bullet.ER_TINY_RENDERER if tiny else bullet.ER_BULLET_HARDWARE_OPENGL,
                flags=0 if tiny else bullet.ER_NO_SEGMENTATION_MASK,
                physicsClientId=self._client,
                **light,
            )
        shape = (height, width)
        colour = np.asarray(rgba, dtype=np.uint8).reshape(*shape, 4)[..., :3]
        return colour, np.reshape(buffer, shape), np.reshape(body, shape)

    def _geometry(self, mesh: Mesh, uvs: Float[np.ndarray, "v 2"]) -> dict:
        if self._renderer == "egl":
            # Its plugin crashes on meshes given in memory, and reads the same ones from files;
            # a file's name that it has seen before stands for the mesh of then.
            path = Path(self._files.name) / f"{self._bullet.getNumBodies(self._client)}.obj"
            path.write_text(_obj(mesh.vertices_m, uvs, mesh.faces))
            return {"fileName": str(path)}
        return {
            "vertices": mesh.vertices_m.tolist(),
            "indices": mesh.faces.reshape(-1).tolist(),
            "uvs": uvs.tolist(),
            "normals": mesh.normals.tolist(),
        }

    def _texture(self, name: str) -> int:
        if name not in self._textures:
            path = Path(self._files.name) / f"{len(self._textures)}.png"
            Image.fromarray(_texture_image(name)).save(path)
            self._textures[name] = self._bullet.loadTexture(str(path), physicsClientId=self._client)
        return self._textures[name]


def _obj(
    vertices_m: Float[np.ndarray, "v 3"],
    uvs: Float[np.ndarray, "v 2"],
    faces: Int[np.ndarray, "f 3"],
) -> str:
    """A Wavefront file, all of whose normals point at EGL's light: it then shows bare colours."""
    vertices = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices_m.tolist()]
    textures = [f"vt {u!r} {v!r}" for u, v in uvs.tolist()]
    triangles = [f"f {a}/{a}/1 {b}/{b}/1 {c}/{c}/1" for a, b, c in (faces + 1).tolist()]
    return "\n".join([*vertices, *textures, "vn {} {} {}".format(*_UP), *triangles, ""])


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
