"""Shadows, by rays to the light, and the light itself where the renderer has none.

Bullet's own shadow map looks at the world's origin from a few metres away, so it holds nothing of
a town. Drawing it also takes longer than these rays. Its EGL renderer has one light of its own,
whatever the weather, so that there all the light comes from here.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..jit import njit
from .weather import Weather

# A ray starts so far above its surface, so that the surface does not shade itself.
LIFT_M = 0.05

Places = Float[np.ndarray, "h w 3"]
Depths = Float[np.ndarray, "h w"]
Picture = UInt8[np.ndarray, "h w 3"]
# Says whether anything lies between points of the world and a light in a direction.
Blocked = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, "3"]], Bool[np.ndarray, "n"]]


def cast_shadows(
    rgb: Picture, points_m: Places, depth_m: Depths, weather: Weather, blocked: Blocked
) -> Picture:
    """Adds the shadows to a picture that was lit as if nothing shaded anything else.

    ``points_m`` are the places in the world that the pixels show; where ``depth_m`` is infinite
    they mean nothing. A shadow keeps the ambient light alone; what is turned away from the light
    has no other anyway.
    """
    normals = surface_normals(points_m, depth_m)
    dark = _dark(points_m, normals, weather, blocked)
    direct = _direct(normals[dark], weather)

    # The renderer lit with ambient and direct light together: the ambient share is what stays.
    shaded = rgb.copy()
    shaded[dark] = rgb[dark] * (weather.ambient / (weather.ambient + direct))
    return shaded


def illuminate(
    rgb: Picture, points_m: Places, depth_m: Depths, weather: Weather, blocked: Blocked
) -> Picture:
    """Lights a picture of bare colors with a weather's light, and leaves the sky as it is.

    The formula is TinyRenderer's, but with flat faces and without highlights. The arguments are
    those of `cast_shadows`.
    """
    normals = surface_normals(points_m, depth_m)
    direct = _direct(normals, weather)
    if weather.shadow:
        direct[_dark(points_m, normals, weather, blocked)] = 0

    lit = np.minimum(rgb * (weather.ambient + direct), 255).astype(np.uint8)
    return np.where(np.isfinite(depth_m)[..., None], lit, rgb)


def _direct(normals: Float[np.ndarray, "*n 3"], weather: Weather) -> Float[np.ndarray, "*n 3"]:
    """Returns the share of each color that comes from the light itself where nothing blocks it.

    Lambert's law: it falls with the cosine between the surface's normal and the light.
    """
    slope = np.maximum(normals @ _towards(weather), 0)
    return weather.diffuse * slope[..., None] * np.array(weather.light_color, dtype=np.float32)


def _dark(
    points_m: Places, normals: Places, weather: Weather, blocked: Blocked
) -> Bool[np.ndarray, "h w"]:
    """Returns where something stands between the light and a surface turned towards it."""
    towards = _towards(weather)
    dark = normals @ towards > 0
    dark[dark] = blocked(points_m[dark] + LIFT_M * normals[dark], towards)
    return dark


def _towards(weather: Weather) -> Float[np.ndarray, "3"]:
    return np.array(weather.towards, dtype=np.float32)


@njit
def surface_normals(points_m: Places, depth_m: Depths) -> Float[np.ndarray, "h w 3"]:
    """Returns unit normals, towards the camera, of the surface that a picture shows.

    Of the two neighbours in a row, and in a column, the one nearer in depth is taken to lie on the
    same surface. The normal is zero where there is none, and at the sky.
    """
    height, width = depth_m.shape
    normals = np.zeros_like(points_m)
    # Beyond the picture's border there is no surface, as in the sky.
    bordered_m = np.full((height + 2, width + 2), np.inf)
    bordered_m[1:-1, 1:-1] = depth_m

    for i in range(height):
        for j in range(width):
            here = depth_m[i, j]
            if not np.isfinite(here):
                continue

            di = _same_surface(here, bordered_m[i, j + 1], bordered_m[i + 2, j + 1])
            dj = _same_surface(here, bordered_m[i + 1, j], bordered_m[i + 1, j + 2])
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
    """Returns on which side the neighbour of nearer depth lies; 0 where both are the sky."""
    if np.isinf(before) and np.isinf(after):
        return 0
    return 1 if abs(after - here) <= abs(before - here) else -1
