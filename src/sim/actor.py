"""Actors on their routes: the habits of each type, and the start and wanted speed of one actor."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from .route import Route, braked


@dataclass(frozen=True)
class Habits:
    """The wishes of a type of actor. Speeds are also limited by the path and by its turns."""

    speed_mps: tuple[float, float]
    accelerate_mps2: float
    brake_mps2: float
    # Distance kept to whatever is ahead when standing.
    gap_m: float
    headway_s: float
    # Distance kept to whatever is passed.
    side_gap_m: float
    turn_radps: float
    # Sideways acceleration that turns are slowed down to.
    turn_mps2: float
    # How widely corners are cut: see `Route.through`.
    corner_m: float


# A column a type, the largest first: they need the most room, so they are placed first.
_TYPES: Final = ("bus", "truck", "car", "motorcycle", "bicycle", "pedestrian")
_HABITS: Final = {
    "speed_mps": ((5.0, 9.0), (5.0, 10.0), (6.0, 13.0), (6.0, 13.0), (3.0, 5.5), (0.9, 1.7)),
    "accelerate_mps2": (1.0, 1.1, 1.8, 2.2, 1.0, 1.0),
    "brake_mps2": (2.0, 2.0, 2.5, 2.5, 2.0, 2.0),
    "gap_m": (2.0, 2.0, 2.0, 1.5, 1.0, 0.4),
    "headway_s": (1.4, 1.4, 1.2, 1.0, 1.0, 0.4),
    "side_gap_m": (0.2, 0.2, 0.2, 0.2, 0.02, 0.02),
    "turn_radps": (0.6, 0.6, 0.8, 0.9, 1.0, 1.5),
    "turn_mps2": (1.5, 1.8, 2.5, 3.0, 2.0, 2.0),
    "corner_m": (4.0, 3.5, 3.0, 2.5, 1.5, 0.5),
}
HABITS: Final = {
    name: Habits(**{habit: values[column] for habit, values in _HABITS.items()})
    for column, name in enumerate(_TYPES)
}


@dataclass(frozen=True)
class Actor:
    """An actor at a place of its route, with the speed it wants where nothing is in the way.

    ``size_m`` is length, width and height.
    """

    type: str
    size_m: tuple[float, float, float]
    route: Route
    start_m: float
    speed_mps: float

    @property
    def habits(self) -> Habits:
        return HABITS[self.type]

    @cached_property
    def start(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, ""]]:
        """Position and heading at the start."""
        return self.route.at(self.start_m)

    @cached_property
    def limit_mps(self) -> Float[np.ndarray, "n"]:
        """The speed that the paths and their turns allow at every sample of the route.

        Each limit is met in time, by braking as hard as the type is used to.
        """
        sharpness = np.maximum(self.route.sharpness(), 1e-6)
        turn_mps = np.sqrt(self.habits.turn_mps2 / sharpness)
        turn_mps = np.minimum(self.habits.turn_radps / sharpness, turn_mps)
        limit_mps = np.minimum(self.route.speed_mps, turn_mps)
        return braked(limit_mps, self.route.spacing_m, self.habits.brake_mps2)
