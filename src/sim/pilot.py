"""The commands that the UAV gets along a route: speed, and altitude by the paper's App. A.1."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..data.rates import STEP_HZ
from .route import Route, braked, gaussian_window, slow_wave

STEP_S = 1 / STEP_HZ


@dataclass(frozen=True)
class FlightConfig:
    """The settings of a flight. Altitudes are heights above the terrain."""

    cruise_mps: tuple[float, float] = (4.0, 9.0)
    accelerate_mps2: float = 2.0
    brake_mps2: float = 2.5
    # Sideways acceleration that turns are slowed down to.
    turn_mps2: float = 3.0
    drag_per_s: float = 0.15
    # How widely corners are cut: see `Route.through`.
    corner_m: float = 5.0

    altitude_range_m: tuple[float, float] = (2.5, 16.0)
    # h_ref is drawn once a flight, exponentially above the lower end of its range: with what
    # obstacles add, this gives the paper's mean of 7.2 m and 86 % of the frames below 11 m.
    altitude_scale_m: float = 4.7
    altitude_drift_m: float = 0.8
    # Where the target altitude would pass this, the UAV stops.
    ceiling_m: float = 19.0
    climb_mps: float = 3.0
    descend_mps: float = 2.0
    # The paper's d_min and lambda_h.
    clearance_m: float = 1.0
    clearance_per_speed_s: float = 0.15

    # Half the width of the space along the route in which rays look for obstacles.
    tube_m: float = 1.2
    # How far ahead they look, beyond the stopping distance.
    preview_s: float = 0.5
    # Distance from an obstacle that has not been climbed over.
    standoff_m: float = 3.0
    # Nearer than this to anything, at any step, the flight is thrown away.
    touch_m: float = 0.6
    # Flights that are slower than this on the whole are thrown away too.
    slowest_mps: float = 1.5
    tries: int = 64

    # Standard deviation of the window by which the airframe smooths its commands.
    response_s: float = 0.3
    # Ornstein-Uhlenbeck roll and pitch, in rad per root second: std sigma / sqrt(2 kappa).
    gust_kappa_per_s: float = 1.0
    gust_sigma_rad: float = 0.135
    gust_response_s: float = 0.08
    tilt_limit_rad: float = 0.5236


# The commanded place at each step: arc of the route, and height above the terrain. It begins
# `lead_steps` before the flight and ends as many after it, so that it can be smoothed.
Command = tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s"]]


def lead_steps(config: FlightConfig) -> int:
    """Returns how many steps smoothing and a second difference need on either side of a flight."""
    return len(gaussian_window(config.response_s / STEP_S)) // 2 + 1


class Pilot:
    """Commands one flight along a route whose obstacles are known.

    ``obstacle_m`` has one height above the terrain for every sample of the route.
    """

    def __init__(
        self,
        route: Route,
        obstacle_m: Float[np.ndarray, "n"],
        rng: np.random.Generator,
        config: FlightConfig,
        cruise_mps: float,
        duration_s: float,
    ) -> None:
        self._route, self._obstacle_m, self._config = route, obstacle_m, config
        steps = round(duration_s / STEP_S) + 2 * lead_steps(config)
        time_s = np.arange(steps) * STEP_S

        # The order of these two draws is part of what a seed means.
        self._wanted_mps = cruise_mps * (1 + 0.1 * slow_wave(rng, time_s, (5.0, 20.0)))
        self._reference_m = reference_altitude(rng, time_s, config)
        self._limit_mps = _speed_limit(route, config)

        # Higher than this, the target altitude would pass the ceiling at the highest speed flown.
        margin_m = config.clearance_per_speed_s * self._wanted_mps.max()
        self._passable_m = config.ceiling_m - config.clearance_m - margin_m

    def fly_from(self, arc_m: float) -> Command:
        """Returns the whole command, which begins at the target altitude of its first step."""
        steps = len(self._wanted_mps)
        arcs_m, altitudes_m = np.empty(steps), np.empty(steps)
        speed_mps = min(self._wanted_mps[0], self._limit_at(arc_m))
        altitude_m = self._target_altitude(0, arc_m, speed_mps)

        for k in range(steps):
            altitude_m = self._climbed(altitude_m, self._target_altitude(k, arc_m, speed_mps))
            arcs_m[k], altitudes_m[k] = arc_m, altitude_m
            speed_mps = self._paced(k, arc_m, altitude_m, speed_mps)
            arc_m += speed_mps * STEP_S
        return arcs_m, altitudes_m

    def _target_altitude(self, k: int, arc_m: float, speed_mps: float) -> float:
        """Returns the paper's h*: the wish, or higher where obstacles and speed demand it.

        An obstacle too tall to be passed does not raise it: there the UAV stops.
        """
        ahead_m = self._obstacle_m[self._look_ahead(arc_m, speed_mps)]
        observed_m = ahead_m[ahead_m <= self._passable_m].max(initial=0.0)
        margin_m = self._config.clearance_m + self._config.clearance_per_speed_s * speed_mps
        return max(self._reference_m[k], observed_m + margin_m)

    def _climbed(self, altitude_m: float, target_m: float) -> float:
        """Takes one step of the paper's bounded ascent and descent."""
        most_m, least_m = self._config.climb_mps * STEP_S, -self._config.descend_mps * STEP_S
        return altitude_m + min(max(target_m - altitude_m, least_m), most_m)

    def _paced(self, k: int, arc_m: float, altitude_m: float, speed_mps: float) -> float:
        """Returns the next speed: as wished, but slow enough for turns and uncleared obstacles."""
        window = self._look_ahead(arc_m, speed_mps)
        ahead_m = self._obstacle_m[window]
        in_the_way = ahead_m + self._config.clearance_m > altitude_m
        distance_m = self._route.arc_m[window][in_the_way] - arc_m
        stopping_mps = _stopping_speed(distance_m, self._config)
        fastest_mps = min(self._wanted_mps[k], self._limit_at(arc_m), stopping_mps)

        change_mps = min(fastest_mps - speed_mps, self._config.accelerate_mps2 * STEP_S)
        return max(speed_mps + max(change_mps, -self._config.brake_mps2 * STEP_S), 0.0)

    def _look_ahead(self, arc_m: float, speed_mps: float) -> slice:
        """Returns the samples from just behind the UAV to beyond its stopping distance."""
        config, spacing_m = self._config, self._route.spacing_m
        ahead_m = config.standoff_m + speed_mps * config.preview_s
        ahead_m += speed_mps**2 / (2 * config.brake_mps2)
        behind = int((arc_m - config.tube_m) // spacing_m)
        return slice(max(behind, 0), int((arc_m + ahead_m) // spacing_m) + 2)

    def _limit_at(self, arc_m: float) -> float:
        return float(np.interp(arc_m, self._route.arc_m, self._limit_mps))


def reference_altitude(
    rng: np.random.Generator, time_s: Float[np.ndarray, "s"], config: FlightConfig
) -> Float[np.ndarray, "s"]:
    """Draws the paper's h_ref: a base for the flight, and a slow drift that stays in the range."""
    low_m, high_m = config.altitude_range_m
    # Bases above the range are drawn again, so that the range truncates the distribution.
    base_m = np.inf
    while base_m >= high_m:
        base_m = low_m + rng.exponential(config.altitude_scale_m)
    drift_m = min(config.altitude_drift_m, base_m - low_m, high_m - base_m)
    return base_m + drift_m * slow_wave(rng, time_s, (8.0, 30.0))


def _speed_limit(route: Route, config: FlightConfig) -> Float[np.ndarray, "n"]:
    turn_mps = np.sqrt(config.turn_mps2 / np.maximum(route.sharpness(), 1e-6))
    limit_mps = np.minimum(route.speed_mps, turn_mps)
    return braked(limit_mps, route.spacing_m, config.brake_mps2)


def _stopping_speed(distance_m: Float[np.ndarray, "n"], config: FlightConfig) -> float:
    """Returns the speed at which the UAV can still stop before the nearest of places ahead."""
    ahead_m = distance_m[distance_m > 0]
    if not len(ahead_m):
        return np.inf
    return float(np.sqrt(2 * config.brake_mps2 * max(ahead_m[0] - config.standoff_m, 0)))
