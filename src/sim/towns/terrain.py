"""Gentle ground: a sum of low, long waves, so that no road is exactly flat."""

import numpy as np

from ..layout import HeightField
from ..solid import Rng


def rolling(rng: Rng, height_m: float = 0.35, waves: int = 3) -> HeightField:
    """Waves of 60 to 150 m in random directions, within ``height_m`` above and below zero."""
    heading = rng.uniform(0, 2 * np.pi, waves)
    number = 2 * np.pi / rng.uniform(60, 150, waves)
    phase = rng.uniform(0, 2 * np.pi, waves)
    share = rng.uniform(0.5, 1.0, waves)
    amplitude_m = height_m * share / share.sum()

    def terrain(x_m, y_m):
        along = np.multiply.outer(x_m, np.cos(heading)) + np.multiply.outer(y_m, np.sin(heading))
        return (amplitude_m * np.sin(number * along + phase)).sum(axis=-1)

    return terrain
