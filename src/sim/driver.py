"""The drive of all actors along their routes, by the Intelligent Driver Model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from .actor import Actor
from .junction import RightOfWay
from .lights import LightPlan
from .sight import LOOK_M, look_ahead

# Accelerations are chosen this often and held in between.
DECISION_S: Final = 0.1
EMERGENCY_MPS2: Final = 8.0


@dataclass(frozen=True)
class Motion:
    """Arc and speed of every actor at every decision, and the acceleration held after it."""

    arc_m: Float[np.ndarray, "d n"]
    speed_mps: Float[np.ndarray, "d n"]
    acceleration_mps2: Float[np.ndarray, "d n"]

    def arc_at(self, time_s: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t n"]:
        """Returns the arcs in metres at any times of the drive."""
        k = np.minimum((time_s / DECISION_S + 1e-6).astype(int), len(self.arc_m) - 1)
        since_s = (time_s - k * DECISION_S)[:, None]
        arc_m = self.arc_m[k] + self.speed_mps[k] * since_s
        return arc_m + 0.5 * self.acceleration_mps2[k] * since_s**2


def drive(
    actors: Sequence[Actor], duration_s: float, plans: Mapping[int, LightPlan] | None = None
) -> Motion:
    """Drives all actors along their routes, each minding what is ahead on its own.

    At junctions they give way to each other and obey the lights; ``plans`` are those of the
    junctions that have any.
    """
    crowd = _Crowd(actors, RightOfWay(actors, plans or {}))
    steps = int(np.ceil(duration_s / DECISION_S)) + 1
    arcs_m, speeds_mps, accelerations_mps2 = np.zeros((3, steps, len(actors)))
    arc_m = np.array([actor.start_m for actor in actors])
    speed_mps = crowd.calm_speed(arc_m)

    for k in range(steps):
        acceleration_mps2 = crowd.accelerations(k * DECISION_S, arc_m, speed_mps)
        arcs_m[k], speeds_mps[k], accelerations_mps2[k] = arc_m, speed_mps, acceleration_mps2
        arc_m = arc_m + speed_mps * DECISION_S + 0.5 * acceleration_mps2 * DECISION_S**2
        speed_mps = np.maximum(speed_mps + acceleration_mps2 * DECISION_S, 0)
    return Motion(arcs_m, speeds_mps, accelerations_mps2)


class _Crowd:
    """The actors' routes and habits as arrays, routes padded to a common length."""

    def __init__(self, actors: Sequence[Actor], right_of_way: RightOfWay) -> None:
        habits = [actor.habits for actor in actors]
        self._right_of_way = right_of_way
        self._accelerate = np.array([habit.accelerate_mps2 for habit in habits])
        self._brake = np.array([habit.brake_mps2 for habit in habits])
        self._gap_m = np.array([habit.gap_m for habit in habits])
        self._headway_s = np.array([habit.headway_s for habit in habits])
        self._side_gap_m = np.array([habit.side_gap_m for habit in habits])
        self._wanted_mps = np.array([actor.speed_mps for actor in actors])
        self._size_m = np.array([actor.size_m[:2] for actor in actors])

        # The kernel that looks ahead takes all routes at once, so they get one length.
        routes = [actor.route for actor in actors]
        self._spacing_m = routes[0].spacing_m
        self._points_m = _padded([route.points_m for route in routes])
        self._heading_rad = _padded([route.heading_rad for route in routes])
        self._limit_mps = _padded([actor.limit_mps for actor in actors])
        self._end_m = np.array([route.length_m for route in routes])

    def calm_speed(self, arc_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Returns the highest speeds at which no actor need brake harder than is comfortable."""
        speed_mps = np.minimum(self._wanted_mps, self._limit_at(arc_m))
        for _ in range(int(speed_mps.max() / (self._brake.min() * DECISION_S)) + 1):
            hard = self.accelerations(0.0, arc_m, speed_mps) < -self._brake
            speed_mps = np.maximum(speed_mps - hard * self._brake * DECISION_S, 0)
        return speed_mps

    def accelerations(
        self, time_s: float, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Returns the accelerations of the Intelligent Driver Model (Treiber et al. 2000).

        The end of a route is a wall.
        """
        gap_m, lead_mps = self._ahead(arc_m, speed_mps)
        free_mps = np.maximum(np.minimum(self._wanted_mps, self._limit_at(arc_m)), 0.1)
        closing_mps = speed_mps - lead_mps
        comfort_mps2 = 2 * np.sqrt(self._accelerate * self._brake)
        closing_m = speed_mps * self._headway_s + speed_mps * closing_mps / comfort_mps2
        wanted_gap_m = self._gap_m + np.maximum(closing_m, 0)
        wish = 1 - (speed_mps / free_mps) ** 4 - (wanted_gap_m / np.maximum(gap_m, 0.1)) ** 2

        # The model only drifts towards a lower limit; a turn and a stop line must be met in time.
        next_m = arc_m + speed_mps * DECISION_S
        stop_m = self._right_of_way.stops_m(time_s, arc_m, speed_mps)
        stopping_mps = np.sqrt(2 * self._brake * np.maximum(stop_m - next_m, 0))
        next_limit_mps = np.minimum(self._limit_at(next_m), stopping_mps)
        wanted = np.minimum(self._accelerate * wish, (next_limit_mps - speed_mps) / DECISION_S)
        hardest = np.minimum(EMERGENCY_MPS2, speed_mps / DECISION_S)
        return np.clip(wanted, -hardest, self._accelerate)

    def _ahead(
        self, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Returns the free distance before each actor, and how fast its end moves away."""
        front_m = arc_m + self._size_m[:, 0] / 2
        routes = self._points_m, self._heading_rad
        places = self._index(arc_m), self._index(front_m), round(LOOK_M / self._spacing_m)
        gap_m, lead_mps = look_ahead(*routes, *places, self._size_m, self._side_gap_m, speed_mps)
        to_end_m = self._end_m - front_m
        return np.minimum(gap_m, to_end_m), np.where(gap_m < to_end_m, lead_mps, 0.0)

    def _limit_at(self, arc_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Returns the speed that path and turns allow, interpolated between samples."""
        actors, last = np.arange(len(arc_m)), self._limit_mps.shape[1] - 1
        at = np.clip(arc_m / self._spacing_m, 0, last)
        before, share = at.astype(int), at % 1
        after_mps = self._limit_mps[actors, np.minimum(before + 1, last)]
        return (1 - share) * self._limit_mps[actors, before] + share * after_mps

    def _index(self, arc_m: Float[np.ndarray, "n"]) -> np.ndarray:
        nearest = np.rint(arc_m / self._spacing_m).astype(int)
        return np.clip(nearest, 0, self._points_m.shape[1] - 1)


def _padded(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Stacks arrays of different lengths; each shorter one repeats its last row."""
    longest = max(map(len, arrays))
    return np.stack([values[np.minimum(np.arange(longest), len(values) - 1)] for values in arrays])
