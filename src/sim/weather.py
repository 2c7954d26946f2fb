"""Light and weather as plain data: what the renderer is told, and what `air` paints over it."""

from dataclasses import dataclass

import numpy as np

from ..errors import UserError

Color = tuple[float, float, float]
"""sRGB, 0 to 1."""


@dataclass(frozen=True)
class Weather:
    """One illumination-weather condition.

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
    cloud_cover: float = 0.0
    cloud_color: Color = (0.95, 0.96, 0.98)
    glow: Color = (0.0, 0.0, 0.0)
    rain: float = 0.0
    wetness: float = 0.0
    exposure: Color = (1.0, 1.0, 1.0)
    lamps: Color = (0.0, 0.0, 0.0)
    read_noise: float = 0.004
    shot_noise: float = 0.010

    @property
    def towards(self) -> tuple[float, float, float]:
        """The unit vector of the world that points at the light."""
        level = np.cos(self.light_elevation_rad)
        return (
            float(level * np.cos(self.light_azimuth_rad)),
            float(level * np.sin(self.light_azimuth_rad)),
            float(np.sin(self.light_elevation_rad)),
        )

    def light(self) -> dict[str, object]:
        """The light as keyword arguments of pybullet's ``getCameraImage``, all of them.

        The renderer remembers what it was last told, so a frame must say everything.
        """
        return {
            "lightDirection": list(self.towards),
            "lightColor": list(self.light_color),
            "lightAmbientCoeff": self.ambient,
            "lightDiffuseCoeff": self.diffuse,
            "lightSpecularCoeff": self.specular,
            "shadow": int(self.shadow),
        }


WEATHERS: dict[str, Weather] = {
    "clear": Weather(
        light_elevation_rad=0.95,
        light_azimuth_rad=0.7,
        light_color=(1.0, 0.97, 0.92),
        ambient=0.50,
        diffuse=0.65,
        specular=0.10,
        shadow=True,
        sky_horizon=(0.74, 0.85, 0.95),
        sky_zenith=(0.20, 0.42, 0.80),
        fog_per_m=0.0008,
        fog_color=(0.80, 0.86, 0.92),
        cloud_cover=0.30,
        glow=(0.25, 0.22, 0.15),
    ),
    "cloudy": Weather(
        light_elevation_rad=1.2,
        light_azimuth_rad=2.0,
        light_color=(0.92, 0.95, 1.0),
        ambient=0.72,
        diffuse=0.28,
        specular=0.0,
        shadow=False,
        sky_horizon=(0.84, 0.86, 0.88),
        sky_zenith=(0.76, 0.79, 0.83),
        fog_per_m=0.0015,
        fog_color=(0.78, 0.80, 0.82),
        exposure=(0.92, 0.93, 0.95),
        cloud_cover=0.95,
        cloud_color=(0.66, 0.68, 0.71),
        read_noise=0.004,
        shot_noise=0.012,
    ),
    "wet": Weather(
        light_elevation_rad=0.8,
        light_azimuth_rad=-0.9,
        light_color=(1.0, 0.98, 0.95),
        ambient=0.58,
        diffuse=0.48,
        specular=0.35,
        shadow=True,
        sky_horizon=(0.80, 0.84, 0.88),
        sky_zenith=(0.45, 0.56, 0.72),
        fog_per_m=0.002,
        fog_color=(0.76, 0.80, 0.84),
        wetness=0.22,
        cloud_cover=0.60,
        cloud_color=(0.88, 0.90, 0.92),
        glow=(0.20, 0.18, 0.12),
    ),
    "rain": Weather(
        light_elevation_rad=1.3,
        light_azimuth_rad=0.3,
        light_color=(0.88, 0.92, 1.0),
        ambient=0.68,
        diffuse=0.25,
        specular=0.15,
        shadow=False,
        sky_horizon=(0.70, 0.73, 0.76),
        sky_zenith=(0.58, 0.62, 0.66),
        fog_per_m=0.006,
        fog_color=(0.64, 0.67, 0.70),
        rain=4.0,
        wetness=0.20,
        exposure=(0.86, 0.88, 0.92),
        cloud_cover=0.9,
        cloud_color=(0.50, 0.53, 0.57),
        read_noise=0.006,
        shot_noise=0.014,
    ),
    "heavy_rain": Weather(
        light_elevation_rad=1.3,
        light_azimuth_rad=-2.2,
        light_color=(0.84, 0.89, 1.0),
        ambient=0.66,
        diffuse=0.18,
        specular=0.15,
        shadow=False,
        sky_horizon=(0.52, 0.55, 0.58),
        sky_zenith=(0.36, 0.39, 0.44),
        fog_per_m=0.014,
        fog_color=(0.52, 0.55, 0.58),
        rain=14.0,
        wetness=0.30,
        exposure=(0.74, 0.77, 0.82),
        cloud_cover=0.9,
        cloud_color=(0.34, 0.37, 0.41),
        read_noise=0.008,
        shot_noise=0.018,
    ),
    "fog": Weather(
        light_elevation_rad=1.1,
        light_azimuth_rad=1.4,
        light_color=(0.95, 0.97, 1.0),
        ambient=0.75,
        diffuse=0.20,
        specular=0.0,
        shadow=False,
        sky_horizon=(0.78, 0.80, 0.82),
        sky_zenith=(0.70, 0.73, 0.77),
        fog_per_m=0.040,
        fog_color=(0.80, 0.82, 0.84),
        exposure=(0.95, 0.96, 0.97),
    ),
    "sunset": Weather(
        light_elevation_rad=0.22,
        light_azimuth_rad=2.9,
        light_color=(1.0, 0.72, 0.45),
        ambient=0.45,
        diffuse=0.70,
        specular=0.12,
        shadow=True,
        sky_horizon=(0.98, 0.66, 0.38),
        sky_zenith=(0.30, 0.33, 0.55),
        fog_per_m=0.002,
        fog_color=(0.90, 0.64, 0.46),
        exposure=(0.98, 0.82, 0.68),
        cloud_cover=0.45,
        cloud_color=(0.78, 0.50, 0.45),
        glow=(0.50, 0.32, 0.10),
        read_noise=0.005,
        shot_noise=0.014,
    ),
    "wet_sunset": Weather(
        light_elevation_rad=0.18,
        light_azimuth_rad=-0.4,
        light_color=(1.0, 0.66, 0.42),
        ambient=0.48,
        diffuse=0.55,
        specular=0.40,
        shadow=True,
        sky_horizon=(0.88, 0.58, 0.42),
        sky_zenith=(0.32, 0.32, 0.48),
        fog_per_m=0.005,
        fog_color=(0.78, 0.56, 0.46),
        wetness=0.22,
        exposure=(0.86, 0.70, 0.60),
        cloud_cover=0.75,
        cloud_color=(0.55, 0.42, 0.46),
        glow=(0.40, 0.22, 0.08),
        read_noise=0.008,
        shot_noise=0.018,
    ),
    "night": Weather(
        light_elevation_rad=0.9,
        light_azimuth_rad=-1.8,
        light_color=(0.80, 0.88, 1.0),
        ambient=0.55,
        diffuse=0.45,
        specular=0.05,
        shadow=False,
        sky_horizon=(0.20, 0.17, 0.19),
        sky_zenith=(0.02, 0.03, 0.08),
        fog_per_m=0.003,
        fog_color=(0.13, 0.13, 0.17),
        exposure=(0.20, 0.24, 0.36),
        cloud_cover=0.3,
        cloud_color=(0.11, 0.11, 0.14),
        lamps=(0.34, 0.25, 0.12),
        read_noise=0.014,
        shot_noise=0.040,
    ),
    "rainy_night": Weather(
        light_elevation_rad=1.2,
        light_azimuth_rad=0.9,
        light_color=(0.82, 0.88, 1.0),
        ambient=0.60,
        diffuse=0.30,
        specular=0.20,
        shadow=False,
        sky_horizon=(0.19, 0.17, 0.18),
        sky_zenith=(0.08, 0.08, 0.11),
        fog_per_m=0.008,
        fog_color=(0.15, 0.15, 0.19),
        rain=6.0,
        wetness=0.28,
        exposure=(0.19, 0.23, 0.33),
        cloud_cover=0.9,
        cloud_color=(0.13, 0.12, 0.14),
        lamps=(0.30, 0.22, 0.12),
        read_noise=0.016,
        shot_noise=0.044,
    ),
}


def weather_named(name: str) -> Weather:
    """Raises `UserError` for a name that `WEATHERS` does not have."""
    if name not in WEATHERS:
        raise UserError(f"weather: no {name!r}; there are {', '.join(WEATHERS)}")
    return WEATHERS[name]
