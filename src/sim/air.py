"""Sky, water, fog, rain and the sensor, painted over a rendered picture."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ..jit import njit
from ..ontology import GROUND
from .rain import draw_rain
from .sky import Sky, sky_at
from .value_noise import value_noise
from .weather import Weather
from .world import Rendering

# Width of a typical puddle.
PUDDLE_M = 4.0
# Rows around the mirrored one that wet ground blends, as it is no clean mirror; for 448 rows.
MIRROR_ROWS = (-6, -3, 0, 3, 6)
# Height over which the light of street lamps fades.
LAMP_HEIGHT_M = 6.0
# Grass is ground too, but does not shine: how fast shine goes as green exceeds red and blue.
GREEN_IS_DULL = 12.0


def apply_weather(
    rendering: Rendering,
    world_from_camera: Float[Tensor, "4 4"],
    pix_from_camera: Float[Tensor, "3 3"],
    weather: Weather,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """Returns a rendered picture under a weather.

    The sky turns with the camera, and water lies on the ground.
    """
    rgb, depth_m = rendering.rgb, rendering.depth_m
    image = np.empty(rgb.shape, dtype=np.float32)

    # Where the camera is, and the direction through (u, v, 1) whose z-depth is 1 m.
    place_m = world_from_camera[:3, 3].numpy().astype(np.float32)
    directions = (world_from_camera[:3, :3] @ torch.linalg.inv(pix_from_camera)).numpy()
    world_from_pix = directions.astype(np.float32)

    # Water darkens every surface, whatever lights it: both kinds of light shrink alike.
    exposure = tuple(share * (1 - weather.wetness) / 255 for share in weather.exposure)
    lamps = tuple(share * (1 - weather.wetness) / 255 for share in weather.lamps)
    _fill(image, rgb, depth_m, place_m, world_from_pix, exposure, lamps, Sky.of(weather))

    if weather.wetness > 0:
        pix_from_world = np.linalg.inv(directions).astype(np.float32)
        ground = rendering.class_id == GROUND
        matrices = world_from_pix, pix_from_world
        image = _wet(image, rgb, depth_m, ground, place_m, *matrices, weather.fog_per_m)
    if weather.rain > 0:
        draw_rain(image, weather, rng)

    seed = rng.integers(2**63)
    return _exposed(image, seed, weather.read_noise, weather.shot_noise)


@njit(inline="always")
def _look(world_from_pix, row, column):
    """Returns the unit direction through a pixel's center, and its length at a z-depth of 1 m."""
    u, v = np.float32(column + 0.5), np.float32(row + 0.5)
    x = world_from_pix[0, 0] * u + world_from_pix[0, 1] * v + world_from_pix[0, 2]
    y = world_from_pix[1, 0] * u + world_from_pix[1, 1] * v + world_from_pix[1, 2]
    z = world_from_pix[2, 0] * u + world_from_pix[2, 1] * v + world_from_pix[2, 2]
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length, length


@njit
def _fill(image, rgb, depth_m, place_m, world_from_pix, exposure, lamps, sky):
    """Paints lit surfaces as seen through fog, and the sky where there are none.

    Beer-Lambert: a part of the light is left, and the fog's own takes the place of the rest.
    """
    height, width = depth_m.shape
    for row in range(height):
        for column in range(width):
            x, y, z, length = _look(world_from_pix, row, column)
            if np.isinf(depth_m[row, column]):
                for k, value in enumerate(sky_at(x, y, z, sky)):
                    image[row, column, k] = value
                continue

            range_m = depth_m[row, column] * length
            left = np.exp(-np.float32(sky.fog_per_m) * np.float32(range_m))
            near_lamps = np.float32(0)
            if max(lamps) > 0:
                high_m = np.float32(max(place_m[2] + z * range_m, np.float32(0)))
                near_lamps = np.exp(-high_m / np.float32(LAMP_HEIGHT_M))

            for k in range(3):
                light = np.float32(exposure[k]) + np.float32(lamps[k]) * near_lamps
                fog = np.float32(sky.fog_color[k])
                image[row, column, k] = fog + (rgb[row, column, k] * light - fog) * left


@njit
def _wet(image, rgb, depth_m, ground, place_m, world_from_pix, pix_from_world, fog_per_m):
    """Lets ground mirror what stands above the horizon, after Fresnel; puddles mirror most."""
    shining = image.copy()
    height, width = depth_m.shape
    for row in range(height):
        for column in range(width):
            x, y, z, length = _look(world_from_pix, row, column)
            if not ground[row, column] or z >= 0:
                continue

            range_m = np.float32(depth_m[row, column]) * length
            puddle = _puddle(place_m[0] + x * range_m, place_m[1] + y * range_m, range_m)
            red, green, blue = rgb[row, column]
            greenness = (np.float32(green) - max(red, blue)) / np.float32(255)
            dull = min(max(np.float32(GREEN_IS_DULL) * greenness, np.float32(0)), np.float32(1))

            # Schlick's form of Fresnel's law for water: 2 % straight down, all of it at grazing.
            grazing = (1 + z) * (1 + z)
            mirrored = np.float32(0.02) + np.float32(0.98) * grazing * grazing * (1 + z)
            share = (1 - dull) * mirrored * (np.float32(0.45) + np.float32(0.55) * puddle)
            share = share * np.exp(-np.float32(fog_per_m) * range_m)

            darker = 1 - np.float32(0.3) * puddle * (1 - dull)
            above = _mirrored(image, pix_from_world, x, y, -z)
            for k in range(3):
                own = shining[row, column, k] * darker
                shining[row, column, k] = own + share * (above[k] - own)
    return shining


@njit
def _puddle(x_m, y_m, range_m):
    """Returns the share of puddle at a place of the world; far off they run together."""
    field = value_noise(x_m / PUDDLE_M, y_m / PUDDLE_M, 2)
    inside = min(max((field - np.float32(0.52)) * np.float32(12), np.float32(0)), np.float32(1))
    sharp = np.exp(-range_m / np.float32(40))
    return np.float32(0.4) * (1 - sharp) + inside * sharp


@njit
def _mirrored(image, pix_from_world, x, y, z):
    """Returns the color of the image in a direction, blurred along columns.

    Directions outside the image get the color of its border.
    """
    height, width = image.shape[:2]
    u = pix_from_world[0, 0] * x + pix_from_world[0, 1] * y + pix_from_world[0, 2] * z
    v = pix_from_world[1, 0] * x + pix_from_world[1, 1] * y + pix_from_world[1, 2] * z
    w = pix_from_world[2, 0] * x + pix_from_world[2, 1] * y + pix_from_world[2, 2] * z
    # Behind the camera: far outside the picture instead of mirrored through its center.
    w = max(w, np.float32(1e-3))

    column = int(min(max(u / w, np.float32(0)), np.float32(width - 1)))
    red = green = blue = np.float32(0)
    for step in MIRROR_ROWS:
        shifted = v / w + np.float32(step * height / 448)
        row = int(min(max(shifted, np.float32(0)), np.float32(height - 1)))
        red += image[row, column, 0]
        green += image[row, column, 1]
        blue += image[row, column, 2]
    share = np.float32(1 / len(MIRROR_ROWS))
    return red * share, green * share, blue * share


@njit
def _exposed(image, seed, read_noise, shot_noise):
    """Adds the sensor's noise: read noise everywhere, and shot noise.

    The variance of shot noise is in proportion to the light. Both are given at the gain that the
    weather asks for.
    """
    height, width = image.shape[:2]
    picture = np.empty(image.shape, dtype=np.uint8)
    read, shot = np.float32(read_noise**2), np.float32(shot_noise**2)
    counter = np.uint64(seed)

    for row in range(height):
        for column in range(width):
            for k in range(3):
                counter += np.uint64(0x9E3779B97F4A7C15)
                value = min(max(image[row, column, k], np.float32(0)), np.float32(1))
                value += _normal(counter) * np.sqrt(read + shot * value)
                value = min(max(value, np.float32(0)), np.float32(1))
                picture[row, column, k] = np.uint8(value * np.float32(255) + np.float32(0.5))
    return picture


@njit(inline="always")
def _normal(counter):
    """Returns a nearly normal number of variance 1 from a counter.

    It is the sum of the four 16-bit parts of SplitMix64. NumPy's exact normals take longer than all
    the rest of the weather.
    """
    mixed = (counter ^ (counter >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed = mixed ^ (mixed >> np.uint64(31))

    part = np.uint64(0xFFFF)
    total = (mixed & part) + ((mixed >> np.uint64(16)) & part)
    total += ((mixed >> np.uint64(32)) & part) + (mixed >> np.uint64(48))
    return (np.float32(np.int64(total)) - np.float32(2 * 65535)) * np.float32(3**0.5 / 65536)
