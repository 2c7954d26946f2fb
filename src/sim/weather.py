"""Light and weather as plain data: what the renderer gets, and what `air` paints over it.

A weather is a file of ``conf/sim/weather/``. Its values reach the generator with ``sim.weather``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from ..errors import UserError, closest

# sRGB, each share from 0 to 1.
Color = tuple[float, float, float]

# Least and greatest value of the settings that are no share from 0 to 1. Without any ambient light,
# a shadow would divide by zero.
BOUNDS = {
    "light_elevation_rad": (0.0, math.pi / 2),
    "light_azimuth_rad": (-2 * math.pi, 2 * math.pi),
    "ambient": (0.01, 1.0),
    "fog_per_m": (0.0, 10.0),
    "rain": (0.0, 1000.0),
    "exposure": (0.0, 10.0),
}


@dataclass(frozen=True)
class Weather:
    """One illumination and weather.

    The light and its coefficients are the renderer's; the rest is `air.apply_weather`'s.
    ``cloud_cover`` is the share of the sky behind clouds, roughly. ``glow`` is what the sun adds to
    the sky around it. ``exposure`` multiplies all that is lit, and ``lamps`` is added to it near
    the ground, where street lamps shine. ``wetness`` is the share by which wet surfaces are darker;
    wet ground also mirrors. ``rain`` is the number of streaks per 1,000 pixels of the image. The
    noise's variance is ``read_noise`` squared, plus ``shot_noise`` squared times the pixel's value:
    both grow with the gain that the sensor needs in the dark.
    """

    light_elevation_rad: float
    light_azimuth_rad: float
    light_color: Color
    ambient: float
    diffuse: float
    specular: float
    shadow: bool
    sky_horizon: Color
    sky_zenith: Color
    fog_per_m: float
    fog_color: Color
    cloud_cover: float
    cloud_color: Color
    glow: Color
    rain: float
    wetness: float
    exposure: Color
    lamps: Color
    read_noise: float
    shot_noise: float

    @classmethod
    def of(cls, sim: Mapping, name: str) -> "Weather":
        """Returns the weather of that name, from its values in ``sim["weather"]``.

        Raises `UserError` for a name that is not there, and for a setting that is missing, unknown,
        of another type or out of its bounds.
        """
        weathers = sim.get("weather", {})
        if name not in weathers:
            raise UserError(
                f"sim.weathers: there is no {name!r}{closest(str(name), weathers)} there are "
                f"{', '.join(weathers)}; another one is a file in sim/weather/ of the configuration"
            )

        key, values = f"sim.weather.{name}", weathers[name]
        kinds = {field.name: field.type for field in fields(cls)}
        for setting in values:
            if setting not in kinds:
                raise UserError(
                    f"{key}.{setting}: there is no such setting{closest(setting, kinds)} there are "
                    f"{', '.join(kinds)}"
                )
        if missing := [setting for setting in kinds if setting not in values]:
            raise UserError(f"{key}.{missing[0]}: is missing; give it, or begin with a weather")

        return cls(**{n: _sound(f"{key}.{n}", values[n], kinds[n]) for n in kinds})

    @property
    def towards(self) -> tuple[float, float, float]:
        """Returns the unit vector of the world that points at the light."""
        level = np.cos(self.light_elevation_rad)
        return (
            float(level * np.cos(self.light_azimuth_rad)),
            float(level * np.sin(self.light_azimuth_rad)),
            float(np.sin(self.light_elevation_rad)),
        )

    def light(self) -> dict[str, object]:
        """Returns the light as keyword arguments of pybullet's ``getCameraImage``, all of them.

        The renderer remembers the last frame's settings, so a frame must give all of them.
        """
        return {
            "lightDirection": list(self.towards),
            "lightColor": list(self.light_color),
            "lightAmbientCoeff": self.ambient,
            "lightDiffuseCoeff": self.diffuse,
            "lightSpecularCoeff": self.specular,
            # Shadows are cast by rays, see `lighting`.
            "shadow": 0,
        }


def _sound(key: str, value: object, kind: type) -> float | bool | Color:
    """Returns a setting as its field has it. Raises `UserError` for another type or bounds."""
    if kind is bool:
        if not isinstance(value, bool):
            raise UserError(f"{key}: {value!r} is not true or false")
        return value

    is_color = kind is not float
    if is_color and not (isinstance(value, list | tuple) and len(value) == 3):
        raise UserError(f"{key}: {value!r} is not a list of red, green and blue")
    numbers = value if is_color else [value]

    least, greatest = BOUNDS.get(key.rpartition(".")[2], (0.0, 1.0))
    for number in numbers:
        is_number = isinstance(number, int | float) and not isinstance(number, bool)
        if not is_number or not least <= number <= greatest:
            raise UserError(f"{key}: {number!r} is not a number from {least:g} to {greatest:g}")

    # Whole numbers of YAML become floats, for which the kernels are compiled.
    return tuple(map(float, numbers)) if is_color else float(value)
