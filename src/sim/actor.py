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


# The largest types come first: they need the most room, so they are placed first.
HABITS: Final = {
    # speed, accelerate, brake; gap, headway, side gap; turn (rad/s), turn (m/s2), corner
    "bus": Habits((5.0, 9.0), 1.0, 2.0, 2.0, 1.4, 0.2, 0.6, 1.5, 4.0),
    "truck": Habits((5.0, 10.0), 1.1, 2.0, 2.0, 1.4, 0.2, 0.6, 1.8, 3.5),
    "car": Habits((6.0, 13.0), 1.8, 2.5, 2.0, 1.2, 0.2, 0.8, 2.5, 3.0),
    "motorcycle": Habits((6.0, 13.0), 2.2, 2.5, 1.5, 1.0, 0.2, 0.9, 3.0, 2.5),
    "bicycle": Habits((3.0, 5.5), 1.0, 2.0, 1.0, 1.0, 0.02, 1.0, 2.0, 1.5),
    "pedestrian": Habits((0.9, 1.7), 1.0, 2.0, 0.4, 0.4, 0.02, 1.5, 2.0, 0.5),
}


@dataclass(frozen=True)
class Actor:
    """An actor at a place of its route, with the speed it wants where nothing is in the way.

    ``size_m`` is length, width and height; ``seed`` draws its appearance.
    """

    type: str
    size_m: tuple[float, float, float]
    route: Route
    start_m: float
    speed_mps: float
    seed: int = 0

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
