"""Light and weather: what the renderer is told, and what is painted over its picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from ..errors import UserError

Color = tuple[float, float, float]
"""sRGB, 0 to 1."""

HAZE_TOP_M = 60.0
"""Thickness of the layer of fog through which the sky is seen."""

STREAK_COLOR = np.array([0.78, 0.80, 0.84], dtype=np.float32)
STREAK_ALPHA = 0.35


@dataclass(frozen=True)
class Weather:
    """One illumination-weather condition.

    The light and its coefficients are the renderer's; the rest is `apply_weather`'s. ``wetness``
    is the share by which wet surfaces are darker. ``rain`` is the number of streaks per 1,000
    pixels of the image.
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
    rain: float = 0.0
    wetness: float = 0.0
    exposure: Color = (1.0, 1.0, 1.0)
    noise_std: float = 0.008

    def light(self) -> dict[str, object]:
        """The light as keyword arguments of pybullet's ``getCameraImage``, all of them.

        The renderer remembers what it was last told, so a frame must say everything.
        """
        level = np.cos(self.light_elevation_rad)
        towards = (
            level * np.cos(self.light_azimuth_rad),
            level * np.sin(self.light_azimuth_rad),
            np.sin(self.light_elevation_rad),
        )
        return {
            "lightDirection": [float(value) for value in towards],
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
        sky_horizon=(0.80, 0.88, 0.95),
        sky_zenith=(0.25, 0.48, 0.82),
        fog_per_m=0.0008,
        fog_color=(0.80, 0.86, 0.92),
    ),
    "cloudy": Weather(
        light_elevation_rad=1.2,
        light_azimuth_rad=2.0,
        light_color=(0.92, 0.95, 1.0),
        ambient=0.72,
        diffuse=0.28,
        specular=0.0,
        shadow=False,
        sky_horizon=(0.82, 0.84, 0.86),
        sky_zenith=(0.62, 0.66, 0.71),
        fog_per_m=0.0015,
        fog_color=(0.78, 0.80, 0.82),
        exposure=(0.92, 0.93, 0.95),
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
    ),
    "rain": Weather(
        light_elevation_rad=1.3,
        light_azimuth_rad=0.3,
        light_color=(0.88, 0.92, 1.0),
        ambient=0.68,
        diffuse=0.25,
        specular=0.15,
        shadow=False,
        sky_horizon=(0.66, 0.69, 0.72),
        sky_zenith=(0.48, 0.52, 0.57),
        fog_per_m=0.006,
        fog_color=(0.64, 0.67, 0.70),
        rain=4.0,
        wetness=0.20,
        exposure=(0.86, 0.88, 0.92),
        noise_std=0.012,
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
        rain=12.0,
        wetness=0.28,
        exposure=(0.74, 0.77, 0.82),
        noise_std=0.016,
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
        fog_per_m=0.028,
        fog_color=(0.78, 0.80, 0.82),
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
        noise_std=0.010,
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
        noise_std=0.014,
    ),
    "night": Weather(
        light_elevation_rad=0.9,
        light_azimuth_rad=-1.8,
        light_color=(0.80, 0.88, 1.0),
        ambient=0.55,
        diffuse=0.45,
        specular=0.05,
        shadow=False,
        sky_horizon=(0.13, 0.14, 0.19),
        sky_zenith=(0.03, 0.04, 0.08),
        fog_per_m=0.003,
        fog_color=(0.12, 0.13, 0.17),
        exposure=(0.32, 0.34, 0.42),
        noise_std=0.022,
    ),
    "rainy_night": Weather(
        light_elevation_rad=1.2,
        light_azimuth_rad=0.9,
        light_color=(0.82, 0.88, 1.0),
        ambient=0.60,
        diffuse=0.30,
        specular=0.20,
        shadow=False,
        sky_horizon=(0.15, 0.16, 0.20),
        sky_zenith=(0.06, 0.07, 0.10),
        fog_per_m=0.008,
        fog_color=(0.14, 0.15, 0.19),
        rain=6.0,
        wetness=0.25,
        exposure=(0.34, 0.36, 0.44),
        noise_std=0.026,
    ),
}


def weather_named(name: str) -> Weather:
    """Raises `UserError` for a name that `WEATHERS` does not have."""
    if name not in WEATHERS:
        raise UserError(f"weather: no {name!r}; there are {', '.join(WEATHERS)}")
    return WEATHERS[name]


def apply_weather(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float[np.ndarray, "h w"],
    sky_direction_z: Float[np.ndarray, "h w"],
    weather: Weather,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """The rendered picture under a weather.

    ``depth_m`` is z-depth, inf where the sky is seen; ``sky_direction_z`` is the sine of each pixel
    ray's elevation in the world, so that the sky rolls and pitches with the camera.
    """
    depth_m = depth_m.astype(np.float32)
    tint = np.asarray(weather.exposure, dtype=np.float32) * np.float32((1 - weather.wetness) / 255)
    image = rgb * tint
    sky = np.isinf(depth_m)
    image = _in_fog(image, np.exp(-weather.fog_per_m * np.where(sky, 0, depth_m)), weather)
    image[sky] = _sky(sky_direction_z[sky], weather)
    if weather.rain > 0:
        _draw_rain(image, weather, rng)
    image += weather.noise_std * rng.standard_normal(image.shape, dtype=np.float32)
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def _in_fog(
    image: Float[np.ndarray, "*n 3"], transmittance: Float[np.ndarray, "*n"], weather: Weather
) -> Float[np.ndarray, "*n 3"]:
    """Beer-Lambert: what is left of the light, and the fog's own in the place of the rest."""
    fog = np.asarray(weather.fog_color, dtype=np.float32)
    return fog + (image - fog) * transmittance[..., None]


def _sky(direction_z: Float[np.ndarray, "n"], weather: Weather) -> Float[np.ndarray, "n 3"]:
    horizon, zenith = np.array([weather.sky_horizon, weather.sky_zenith], dtype=np.float32)
    rise = np.clip(direction_z, 0, 1).astype(np.float32)
    sky = horizon + (zenith - horizon) * np.sqrt(rise)[:, None]
    path_m = HAZE_TOP_M / np.maximum(rise, 0.02)
    return _in_fog(sky, np.exp(-weather.fog_per_m * path_m), weather)


def _draw_rain(
    image: Float[np.ndarray, "h w 3"], weather: Weather, rng: np.random.Generator
) -> None:
    """Blends slanted streaks into the image; all of a frame share a wind."""
    height, width = image.shape[:2]
    count = round(weather.rain * height * width / 1000)
    slant = rng.normal(0, 0.15)
    length = rng.uniform(0.04, 0.14, size=(count, 1)) * height
    along = np.linspace(0, 1, int(0.14 * height) + 2)
    v = rng.uniform(-0.1, 1, size=(count, 1)) * height + along * length
    u = rng.uniform(0, width, size=(count, 1)) + slant * along * length
    inside = (v >= 0) & (v < height) & (u >= 0) & (u < width)
    alpha = np.zeros((height, width), dtype=np.float32)
    alpha[v[inside].astype(int), u[inside].astype(int)] = STREAK_ALPHA
    brightness = max(weather.exposure)
    image += alpha[..., None] * (STREAK_COLOR * brightness - image)
