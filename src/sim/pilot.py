"""What the UAV is told to do along a route: speed, and altitude by the paper's App. A.1."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..data.rates import STEP_HZ
from .route import Route, braked, gaussian_window, slow_wave

STEP_S = 1 / STEP_HZ


@dataclass(frozen=True)
class FlightConfig:
    """How the UAV flies. Altitudes are heights above the terrain."""

    cruise_mps: tuple[float, float] = (4.0, 9.0)
    accelerate_mps2: float = 2.0
    brake_mps2: float = 2.5
    turn_mps2: float = 3.0
    """Sideways acceleration that turns are slowed down to."""
    drag_per_s: float = 0.15
    corner_m: float = 5.0
    """How widely corners are cut: see `Route.through`."""

    altitude_range_m: tuple[float, float] = (2.5, 16.0)
    altitude_scale_m: float = 4.7
    """h_ref is drawn once a flight, exponentially above the lower end of its range: with what
    obstacles add, this gives the paper's mean of 7.2 m and 86 % of the frames below 11 m."""
    altitude_drift_m: float = 0.8
    ceiling_m: float = 19.0
    """Where the target altitude would pass this, the UAV stops."""
    climb_mps: float = 3.0
    descend_mps: float = 2.0
    clearance_m: float = 1.0
    """d_min."""
    clearance_per_speed_s: float = 0.15
    """lambda_h."""

    tube_m: float = 1.2
    """Half the width of the space along the route in which rays look for obstacles."""
    preview_s: float = 0.5
    """How far ahead they look, beyond the stopping distance."""
    standoff_m: float = 3.0
    """From an obstacle that has not been climbed over."""
    touch_m: float = 0.6
    """Nearer than this to anything, at any step, the flight is thrown away."""
    slowest_mps: float = 1.5
    """Flights that are slower than this on the whole are thrown away too."""
    tries: int = 64

    response_s: float = 0.3
    """Standard deviation of the window by which the airframe smooths what is commanded."""
    gust_kappa_per_s: float = 1.0
    gust_sigma_rad: float = 0.135
    """Ornstein-Uhlenbeck roll and pitch, in rad per root second: std sigma / sqrt(2 kappa)."""
    gust_response_s: float = 0.08
    tilt_limit_rad: float = 0.5236


@dataclass(frozen=True)
class Command:
    """Where to be at each step: arc of the route, and height above the terrain.

    It begins `lead_steps` before the flight and ends as many after it, so that it can be smoothed.
    """

    arc_m: Float[np.ndarray, "s"]
    altitude_m: Float[np.ndarray, "s"]


def lead_steps(config: FlightConfig) -> int:
    """What the airframe's smoothing window and a second difference need on either side."""
    return len(gaussian_window(config.response_s / STEP_S)) // 2 + 1


class Pilot:
    """Knows one route and the heights of the obstacles on it, and holds the wishes of one flight.

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
        self._wanted_mps = cruise_mps * (1 + 0.1 * slow_wave(rng, time_s, (5.0, 20.0)))
        self._reference_m = reference_altitude(rng, time_s, config)
        self._limit_mps = _speed_limit(route, config)
        # Higher than this, the target altitude would pass the ceiling at the highest speed flown.
        self._passable_m = (
            config.ceiling_m
            - config.clearance_m
            - config.clearance_per_speed_s * self._wanted_mps.max()
        )

    def fly_from(self, arc_m: float) -> Command:
        """The whole command, begun at the target altitude of its first step."""
        steps = len(self._wanted_mps)
        arcs_m, altitudes_m = np.empty(steps), np.empty(steps)
        speed_mps = min(self._wanted_mps[0], self._limit_at(arc_m))
        altitude_m = self._target_altitude(0, arc_m, speed_mps)
        for k in range(steps):
            altitude_m = self._climbed(altitude_m, self._target_altitude(k, arc_m, speed_mps))
            arcs_m[k], altitudes_m[k] = arc_m, altitude_m
            speed_mps = self._paced(k, arc_m, altitude_m, speed_mps)
            arc_m += speed_mps * STEP_S
        return Command(arcs_m, altitudes_m)

    def _target_altitude(self, k: int, arc_m: float, speed_mps: float) -> float:
        """The paper's h*: the wish, or higher where obstacles and speed demand it.

        What is too tall to be passed does not raise it: there the UAV stops.
        """
        ahead_m = self._obstacle_m[self._look_ahead(arc_m, speed_mps)]
        observed_m = ahead_m[ahead_m <= self._passable_m].max(initial=0.0)
        margin_m = self._config.clearance_m + self._config.clearance_per_speed_s * speed_mps
        return max(self._reference_m[k], observed_m + margin_m)

    def _climbed(self, altitude_m: float, target_m: float) -> float:
        """One step of the paper's bounded ascent and descent."""
        most_m, least_m = self._config.climb_mps * STEP_S, -self._config.descend_mps * STEP_S
        return altitude_m + min(max(target_m - altitude_m, least_m), most_m)

    def _paced(self, k: int, arc_m: float, altitude_m: float, speed_mps: float) -> float:
        """The next speed: as wished, slow enough for the turns and for what is not yet cleared."""
        window = self._look_ahead(arc_m, speed_mps)
        ahead_m = self._obstacle_m[window]
        in_the_way = ahead_m + self._config.clearance_m > altitude_m
        distance_m = self._route.arc_m[window][in_the_way] - arc_m
        fastest_mps = min(
            self._wanted_mps[k], self._limit_at(arc_m), _stopping_speed(distance_m, self._config)
        )
        change_mps = min(fastest_mps - speed_mps, self._config.accelerate_mps2 * STEP_S)
        return max(speed_mps + max(change_mps, -self._config.brake_mps2 * STEP_S), 0.0)

    def _look_ahead(self, arc_m: float, speed_mps: float) -> slice:
        """The samples of the route from just behind the UAV to beyond its stopping distance."""
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
    """h_ref: one draw a flight, and a slow drift that stays within the range."""
    low_m, high_m = config.altitude_range_m
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
    """The speed at which the UAV can still stop before the nearest of some places ahead."""
    ahead_m = distance_m[distance_m > 0]
    if not len(ahead_m):
        return np.inf
    return float(np.sqrt(2 * config.brake_mps2 * max(ahead_m[0] - config.standoff_m, 0)))
