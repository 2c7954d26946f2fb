"""Streaks of rain, blended into a picture."""

import numpy as np
from jaxtyping import Float

from ..jit import njit
from .weather import Weather

# Color (sRGB) and greatest opacity of a streak.
STREAK_COLOR = (0.80, 0.83, 0.88)
STREAK_ALPHA = 0.42
# Shortest and longest streak, in heights of the picture: far drops are short and faint.
LENGTH = (0.03, 0.13)
# Standard deviation of the slant of a frame's rain, in columns per row.
WIND_STD = 0.12


def draw_rain(
    image: Float[np.ndarray, "h w 3"], weather: Weather, rng: np.random.Generator
) -> None:
    """Blends slanted streaks into the image (float32, 0 to 1); all of a frame share a wind."""
    height, width = image.shape[:2]
    count = round(weather.rain * height * width / 1000)
    slant = rng.normal(0, WIND_STD)

    # Few drops are near: the number of streaks falls with their length.
    nearness = rng.uniform(size=count) ** 2
    top = rng.uniform(-LENGTH[1], 1, size=count) * height
    left = rng.uniform(-0.1, 1.1, size=count) * width

    brightness = max(weather.exposure)
    color = np.array([share * brightness for share in STREAK_COLOR], dtype=np.float32)
    _draw(image, top, left, nearness, slant + rng.normal(0, 0.02, size=count), color)


@njit
def _draw(image, top, left, nearness, slant, color):
    """Draws streaks that fade in and out; the two pixels under a row of one share it."""
    height, width = image.shape[:2]
    for n in range(len(top)):
        length = (LENGTH[0] + (LENGTH[1] - LENGTH[0]) * nearness[n]) * height
        strength = STREAK_ALPHA * (0.45 + 0.55 * nearness[n])
        for step in range(int(length) + 1):
            row = int(np.floor(top[n])) + step
            along = step / length
            if not 0 <= row < height or along > 1:
                continue

            u = left[n] + slant[n] * step
            column = int(np.floor(u))
            # A parabola along the streak: nothing at both ends, full strength in the middle.
            fade = strength * 4 * along * (1 - along)
            for offset, share in ((0, 1 - (u - column)), (1, u - column)):
                if 0 <= column + offset < width:
                    alpha = np.float32(fade * share)
                    pixel = image[row, column + offset]
                    for k in range(3):
                        pixel[k] += alpha * (color[k] - pixel[k])
