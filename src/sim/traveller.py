"""Who is under way: the habits of each type of road user, and one of them on its route."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from .route import Route, braked


@dataclass(frozen=True)
class Habits:
    """What a type of actor wants. Speeds are also limited by the path and by its turns."""

    speed_mps: tuple[float, float]
    accelerate_mps2: float
    brake_mps2: float
    gap_m: float
    """Kept to whatever is ahead when standing."""
    headway_s: float
    side_gap_m: float
    """Kept to whatever is passed."""
    turn_radps: float
    turn_mps2: float
    """Sideways acceleration that turns are slowed down to."""
    corner_m: float
    """How widely corners are cut: see `Route.through`."""


HABITS: Final = {
    "bus": Habits((5.0, 9.0), 1.0, 2.0, 2.0, 1.4, 0.2, 0.6, 1.5, 4.0),
    "truck": Habits((5.0, 10.0), 1.1, 2.0, 2.0, 1.4, 0.2, 0.6, 1.8, 3.5),
    "car": Habits((6.0, 13.0), 1.8, 2.5, 2.0, 1.2, 0.2, 0.8, 2.5, 3.0),
    "motorcycle": Habits((6.0, 13.0), 2.2, 2.5, 1.5, 1.0, 0.2, 0.9, 3.0, 2.5),
    "bicycle": Habits((3.0, 5.5), 1.0, 2.0, 1.0, 1.0, 0.02, 1.0, 2.0, 1.5),
    "pedestrian": Habits((0.9, 1.7), 1.0, 2.0, 0.4, 0.4, 0.02, 1.5, 2.0, 0.5),
}


@dataclass(frozen=True)
class Traveller:
    """Someone at a place of a route, with the speed wanted where nothing is in the way."""

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
        """Speed that the paths and their turns allow at every sample of the route, met in time."""
        sharpness = np.maximum(self.route.sharpness(), 1e-6)
        turn_mps = np.minimum(
            self.habits.turn_radps / sharpness, np.sqrt(self.habits.turn_mps2 / sharpness)
        )
        limit_mps = np.minimum(self.route.speed_mps, turn_mps)
        return braked(limit_mps, self.route.spacing_m, self.habits.brake_mps2)
