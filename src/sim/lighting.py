"""What light does to a picture beyond what its renderer does: cast shadows, by rays to the light.

Bullet's own shadow map looks at the world's origin from a few metres away, so it holds nothing of
a town; and drawing it takes longer than these rays. Its EGL renderer has one light of its own,
whatever it is told, so that there all the light comes from here.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..jit import njit
from .weather import Weather

LIFT_M = 0.05
"""How far above its surface a ray starts, so that the surface does not shade itself."""

Blocked = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, "3"]], Bool[np.ndarray, "n"]]
"""Whether anything lies between points of the world and a light in a direction."""


def cast_shadows(
    rgb: UInt8[np.ndarray, "h w 3"],
    points_m: Float[np.ndarray, "h w 3"],
    depth_m: Float[np.ndarray, "h w"],
    weather: Weather,
    blocked: Blocked,
) -> UInt8[np.ndarray, "h w 3"]:
    """A picture that was lit as if nothing shaded anything else, with its shadows.

    ``points_m`` are the places in the world that the pixels show; where ``depth_m`` is infinite
    they mean nothing. A shadow keeps the ambient light alone; what is turned away from the light
    has no other anyway.
    """
    normals = surface_normals(points_m, depth_m)
    dark = _dark(points_m, normals, weather, blocked)
    direct = _direct(normals[dark], weather)
    shaded = rgb.copy()
    shaded[dark] = rgb[dark] * (weather.ambient / (weather.ambient + direct))
    return shaded


def illuminate(
    rgb: UInt8[np.ndarray, "h w 3"],
    points_m: Float[np.ndarray, "h w 3"],
    depth_m: Float[np.ndarray, "h w"],
    weather: Weather,
    blocked: Blocked,
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture of a picture of bare colours under a weather's light, the sky left as it is.

    As TinyRenderer, but with flat faces and without highlights. Arguments as of `cast_shadows`.
    """
    normals = surface_normals(points_m, depth_m)
    direct = _direct(normals, weather)
    if weather.shadow:
        direct[_dark(points_m, normals, weather, blocked)] = 0
    lit = np.minimum(rgb * (weather.ambient + direct), 255).astype(np.uint8)
    return np.where(np.isfinite(depth_m)[..., None], lit, rgb)


def _direct(normals: Float[np.ndarray, "*n 3"], weather: Weather) -> Float[np.ndarray, "*n 3"]:
    """The share of each colour that comes from the light itself where it is not blocked."""
    slope = np.maximum(normals @ _towards(weather), 0)
    return weather.diffuse * slope[..., None] * np.array(weather.light_color, dtype=np.float32)


def _dark(
    points_m: Float[np.ndarray, "h w 3"],
    normals: Float[np.ndarray, "h w 3"],
    weather: Weather,
    blocked: Blocked,
) -> Bool[np.ndarray, "h w"]:
    """Where something stands between the light and a surface that is turned towards it."""
    towards = _towards(weather)
    dark = normals @ towards > 0
    dark[dark] = blocked(points_m[dark] + LIFT_M * normals[dark], towards)
    return dark


def _towards(weather: Weather) -> Float[np.ndarray, "3"]:
    return np.array(weather.light()["lightDirection"], dtype=np.float32)


@njit
def surface_normals(
    points_m: Float[np.ndarray, "h w 3"], depth_m: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w 3"]:
    """Unit normals, towards the camera, of the surface that a picture shows.

    Of the two neighbours in a row, and in a column, the one nearer in depth is taken to lie on the
    same surface. Zero where there is none, and at the sky.
    """
    height, width = depth_m.shape
    normals = np.zeros_like(points_m)
    for i in range(height):
        for j in range(width):
            here = depth_m[i, j]
            if not np.isfinite(here):
                continue
            di = _same_surface(
                here,
                depth_m[i - 1, j] if i > 0 else np.inf,
                depth_m[i + 1, j] if i + 1 < height else np.inf,
            )
            dj = _same_surface(
                here,
                depth_m[i, j - 1] if j > 0 else np.inf,
                depth_m[i, j + 1] if j + 1 < width else np.inf,
            )
            if di == 0 or dj == 0:
                continue
            # Scalars, not arrays of three: the loop is then several times as fast.
            ax = dj * (points_m[i, j + dj, 0] - points_m[i, j, 0])
            ay = dj * (points_m[i, j + dj, 1] - points_m[i, j, 1])
            az = dj * (points_m[i, j + dj, 2] - points_m[i, j, 2])
            bx = di * (points_m[i + di, j, 0] - points_m[i, j, 0])
            by = di * (points_m[i + di, j, 1] - points_m[i, j, 1])
            bz = di * (points_m[i + di, j, 2] - points_m[i, j, 2])
            # Columns run to the right and rows down, so that down x right looks at the camera.
            nx, ny, nz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
            length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
            normals[i, j, 0] = nx / length
            normals[i, j, 1] = ny / length
            normals[i, j, 2] = nz / length
    return normals


@njit
def _same_surface(here: float, before: float, after: float) -> int:
    """On which side the neighbour lies whose depth is nearer; 0 where both are the sky."""
    if np.isinf(before) and np.isinf(after):
        return 0
    return 1 if abs(after - here) <= abs(before - here) else -1
