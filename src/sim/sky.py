"""The sky of a weather: a gradient, clouds, and the glow around a low sun, seen through haze."""

from typing import NamedTuple

import numpy as np

from ..jit import njit
from .value_noise import value_noise
from .weather import Color, Weather

# Thickness of the layer of fog through which the sky is seen.
HAZE_TOP_M = 60.0
# Width of a typical cloud, in heights of the clouds above the ground.
CLOUD_SIZE = 0.55


class Sky(NamedTuple):
    """The part of a `Weather` that shapes its sky, as the kernels need it.

    ``towards`` is the unit vector to the sun.
    """

    sky_horizon: Color
    sky_zenith: Color
    cloud_color: Color
    cloud_cover: float
    glow: Color
    towards: tuple[float, float, float]
    fog_color: Color
    fog_per_m: float

    @classmethod
    def of(cls, weather: Weather) -> "Sky":
        return cls(*(getattr(weather, name) for name in cls._fields))


@njit
def sky_at(x: float, y: float, z: float, sky: Sky) -> tuple[float, float, float]:
    """Returns the color in a direction, which is a unit vector of the world.

    Below the horizon it is that of the horizon, but for the sun's glow.
    """
    rise = min(max(np.float32(z), np.float32(0)), np.float32(1))
    cloud = _cloud(x, y, rise, sky)

    # The glow falls with the angle to the sun; the way through the haze grows as 1 / rise.
    along = x * sky.towards[0] + y * sky.towards[1] + z * sky.towards[2]
    glow = np.exp(np.float32(-9) * (1 - np.float32(along)))
    haze = np.exp(-np.float32(sky.fog_per_m * HAZE_TOP_M) / max(rise, np.float32(0.02)))

    # The root brings most of the gradient near the horizon, where a real sky has it.
    height = np.sqrt(rise)
    return (
        _mixed(0, height, cloud, glow, haze, sky),
        _mixed(1, height, cloud, glow, haze, sky),
        _mixed(2, height, cloud, glow, haze, sky),
    )


@njit(inline="always")
def _mixed(k, height, cloud, glow, haze, sky):
    """Mixes one color: the gradient, the sun's glow over it, clouds and then haze before both."""
    horizon, zenith = np.float32(sky.sky_horizon[k]), np.float32(sky.sky_zenith[k])
    value = horizon + (zenith - horizon) * height
    value += np.float32(sky.glow[k]) * glow
    lit = np.float32(sky.cloud_color[k]) + np.float32(sky.glow[k]) * glow
    value += (lit - value) * cloud
    fog = np.float32(sky.fog_color[k])
    return fog + (value - fog) * haze


@njit
def _cloud(x, y, rise, sky):
    """Returns the share of cloud in a direction; clouds fade into the haze of the horizon."""
    if sky.cloud_cover <= 0 or rise <= 0:
        return np.float32(0)

    # The direction meets the clouds' plane at this distance, in typical clouds.
    far = 1 / ((rise + np.float32(0.12)) * np.float32(CLOUD_SIZE))
    # Every sun has its own clouds.
    shift = np.float32(31 * sky.towards[0])
    field = value_noise(x * far + shift, y * far, 3)

    edge = np.float32(0.75 - 0.5 * sky.cloud_cover)
    thick = min(max((field - edge) * np.float32(5), np.float32(0)), np.float32(1))
    return thick * min(rise * np.float32(8), np.float32(1))
