"""The one bullet client: textured meshes that can be moved, hidden and pictured."""

import os
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from PIL import Image

from .mesh import Mesh
from .renderer import egl_plugin, import_bullet, require_renderer, silent
from .scene import Part
from .textures import PALETTE, TEXTURES, Pixels, rgb_of

# All plain colors share one image: cells of 4 x 4 texels in 16 rows of 16.
PALETTE_SIDE: Final = 16
CELL_PIX: Final = 4

_UP: Final = (0.0, 0.0, 1.0)

TextureCoordinates = Float[np.ndarray, "v 2"]


class _Rows:
    """Lists of the rows of arrays, whose rows are always the same lists.

    pybullet 3.2.7 never lets go of a list of vertices that it has read, nor of its rows: 50 MB for
    every town that is drawn. What it keeps is used again here, and `Drawing.add` empties the rest.
    """

    def __init__(self) -> None:
        self._rows: list[list[float]] = []

    def of(self, values: Float[np.ndarray, "v k"]) -> list[list[float]]:
        """Returns the rows of an array, until the next call."""
        self._rows.extend([] for _ in range(len(values) - len(self._rows)))
        rows = self._rows[: len(values)]
        for row, new in zip(rows, values.tolist()):
            row[:] = new
        return rows


_VERTICES, _UVS, _NORMALS = _Rows(), _Rows(), _Rows()


class Drawing:
    """A bullet client of one renderer; see `renderer.RENDERERS`. Meshes have ids from 0 on.

    Raises `UserError` where this machine cannot run the renderer, and `RuntimeError` for a second
    drawing with EGL while one is open: closing either would end the process, for they share a
    context of OpenGL.
    """

    _egl_is_open = False

    def __init__(self, renderer: str) -> None:
        require_renderer(renderer)
        if renderer == "egl":
            if Drawing._egl_is_open:
                raise RuntimeError("a process draws one world at a time with EGL: close it first")
            Drawing._egl_is_open = True

        self._renderer = renderer
        self._bullet = import_bullet()
        self._textures: dict[str, int] = {}
        self._files = tempfile.TemporaryDirectory()
        with silent():
            # Every call of bullet names its client.
            self._client = {"physicsClientId": self._bullet.connect(self._bullet.DIRECT)}
            if renderer == "egl":
                # Clips are made in parallel already; threads of Mesa's would only compete.
                os.environ.setdefault("LP_NUM_THREADS", "1")
                self._bullet.loadPlugin(egl_plugin(), "_eglRendererPlugin", **self._client)

    def close(self) -> None:
        """Ends the client: bullet forgets everything, and nothing can be drawn any more."""
        with silent():
            self._bullet.disconnect(**self._client)
        if self._renderer == "egl":
            Drawing._egl_is_open = False
        self._files.cleanup()

    def add(self, mesh: Mesh, uvs: TextureCoordinates, texture: str) -> int:
        """Adds a mesh, and returns its id.

        ``uvs`` says where its vertices lie in the texture of that name.
        """
        bullet, client = self._bullet, self._client
        geometry = self._geometry(mesh, uvs)

        with silent():
            shape = bullet.createVisualShape(
                bullet.GEOM_MESH, rgbaColor=[1, 1, 1, 1], **geometry, **client
            )
            for kept in geometry.values():
                if isinstance(kept, list):
                    kept.clear()
            bullet_id = bullet.createMultiBody(0, -1, shape, **client)
            image = self._texture(texture)
            bullet.changeVisualShape(bullet_id, -1, textureUniqueId=image, **client)
        return bullet_id

    def show(self, bullet_id: int, is_shown: bool) -> None:
        """Shows or hides a mesh."""
        # Renderers skip what is wholly transparent before they look at its first triangle.
        rgba = [1, 1, 1, float(is_shown)]
        self._bullet.changeVisualShape(bullet_id, -1, rgbaColor=rgba, **self._client)

    def place(self, bullet_id: int, world_from_actor: Float[np.ndarray, "4 4"]) -> None:
        """Moves a mesh that stands upright."""
        yaw_rad = np.arctan2(world_from_actor[1, 0], world_from_actor[0, 0])
        quat_xyzw = [0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)]
        self._bullet.resetBasePositionAndOrientation(
            bullet_id, world_from_actor[:3, 3].tolist(), quat_xyzw, **self._client
        )

    def picture(
        self, width: int, height: int, view: list[float], projection: list[float], light: dict
    ) -> tuple[Pixels, Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
        """Returns color, depth buffer, and the id of the mesh in every pixel (negative: none).

        ``light`` is what `weather.Weather.light` gives. EGL gives the color of the unlit surfaces,
        a coarse depth, and no ids.
        """
        bullet = self._bullet
        if self._renderer == "tiny":
            settings = {"renderer": bullet.ER_TINY_RENDERER, "flags": 0, **light}
            quiet = nullcontext()
        else:
            settings = {
                "renderer": bullet.ER_BULLET_HARDWARE_OPENGL,
                "flags": bullet.ER_NO_SEGMENTATION_MASK,
                "lightDirection": list(_UP),
                "shadow": 0,
            }
            # EGL's first picture reports on OpenGL.
            quiet = silent()

        with quiet:
            _, _, rgba, buffer, bullet_id = bullet.getCameraImage(
                width, height, view, projection, **settings, **self._client
            )
        # A build with numpy gives arrays of these types, one without gives flat tuples of numbers.
        color, shape = np.asarray(rgba, dtype=np.uint8), (height, width)
        depth, ids = np.asarray(buffer, dtype=np.float32), np.asarray(bullet_id, dtype=np.int32)
        return color.reshape(*shape, 4)[..., :3], depth.reshape(shape), ids.reshape(shape)

    def _geometry(self, mesh: Mesh, uvs: TextureCoordinates) -> dict:
        if self._renderer == "egl":
            # Its plugin crashes on meshes given in memory, and reads the same ones from files;
            # a file's name that it has seen before stands for the mesh of then.
            path = Path(self._files.name) / f"{self._bullet.getNumBodies(**self._client)}.obj"
            path.write_text(_obj(mesh, uvs))
            return {"fileName": str(path)}

        return {
            "vertices": _VERTICES.of(mesh.vertices_m),
            "indices": mesh.faces.reshape(-1).tolist(),
            "uvs": _UVS.of(uvs),
            "normals": _NORMALS.of(mesh.normals),
        }

    def _texture(self, name: str) -> int:
        if name not in self._textures:
            path = Path(self._files.name) / f"{len(self._textures)}.png"
            Image.fromarray(_texture_image(name)).save(path)
            self._textures[name] = self._bullet.loadTexture(str(path), **self._client)
        return self._textures[name]


def _obj(mesh: Mesh, uvs: TextureCoordinates) -> str:
    """A Wavefront file, all of whose normals point at EGL's light: it then shows bare colors."""
    vertices = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices_m.tolist()]
    textures = [f"vt {u!r} {v!r}" for u, v in uvs.tolist()]
    triangles = [f"f {a}/{a}/1 {b}/{b}/1 {c}/{c}/1" for a, b, c in (mesh.faces + 1).tolist()]
    return "\n".join([*vertices, *textures, "vn {} {} {}".format(*_UP), *triangles, ""])


def texture_coordinates(part: Part) -> tuple[str, TextureCoordinates]:
    """Returns the texture of a part and where its vertices lie in it.

    Plain colors share the palette.
    """
    if part.material in TEXTURES:
        return part.material, part.mesh.uvs_m / np.array(TEXTURES[part.material].tile_m)
    row, column = divmod(PALETTE.index(part.material), PALETTE_SIDE)
    uv = (np.array([column, row]) + 0.5) / PALETTE_SIDE
    return "palette", np.broadcast_to(uv, part.mesh.uvs_m.shape)


def _texture_image(name: str) -> Pixels:
    if name != "palette":
        # Bullet reads images top row first and v upwards: row 0 of a texture is its top.
        return TEXTURES[name].draw()
    cells = np.zeros((PALETTE_SIDE**2, 3), dtype=np.uint8)
    cells[: len(PALETTE)] = [rgb_of(color) for color in PALETTE]
    image = cells.reshape(PALETTE_SIDE, PALETTE_SIDE, 3)
    return np.flipud(image.repeat(CELL_PIX, axis=0).repeat(CELL_PIX, axis=1)).copy()
