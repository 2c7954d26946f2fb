"""How road users drive, ride and walk: the Intelligent Driver Model, along their own routes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from .junction import RightOfWay
from .sight import LOOK_M, look_ahead
from .signals import SignalPlan
from .traveller import Traveller

DECISION_S: Final = 0.1
"""Accelerations are chosen this often and held in between."""

EMERGENCY_MPS2: Final = 8.0


@dataclass(frozen=True)
class Motion:
    """Arc and speed of every traveller at every decision, and the acceleration held after it."""

    arc_m: Float[np.ndarray, "d n"]
    speed_mps: Float[np.ndarray, "d n"]
    acceleration_mps2: Float[np.ndarray, "d n"]

    def arc_at(self, time_s: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t n"]:
        """Arcs in metres at any times of the drive."""
        k = np.minimum((time_s / DECISION_S + 1e-6).astype(int), len(self.arc_m) - 1)
        since_s = (time_s - k * DECISION_S)[:, None]
        return (
            self.arc_m[k]
            + self.speed_mps[k] * since_s
            + 0.5 * self.acceleration_mps2[k] * since_s**2
        )


def drive(
    travellers: Sequence[Traveller],
    duration_s: float,
    plans: Mapping[int, SignalPlan] | None = None,
) -> Motion:
    """All travellers along their routes, each minding what is ahead on its own.

    At junctions they give way to each other and obey the lights; ``plans`` are those of the
    junctions that have any.
    """
    crowd = _Crowd(travellers, RightOfWay(travellers, plans or {}))
    steps = int(np.ceil(duration_s / DECISION_S)) + 1
    arcs_m, speeds_mps, accelerations_mps2 = np.zeros((3, steps, len(travellers)))
    arc_m = np.array([traveller.start_m for traveller in travellers])
    speed_mps = crowd.calm_speed(arc_m)
    for k in range(steps):
        acceleration_mps2 = crowd.accelerations(k * DECISION_S, arc_m, speed_mps)
        arcs_m[k], speeds_mps[k], accelerations_mps2[k] = arc_m, speed_mps, acceleration_mps2
        arc_m = arc_m + speed_mps * DECISION_S + 0.5 * acceleration_mps2 * DECISION_S**2
        speed_mps = np.maximum(speed_mps + acceleration_mps2 * DECISION_S, 0)
    return Motion(arcs_m, speeds_mps, accelerations_mps2)


class _Crowd:
    """The travellers' routes and habits as arrays, routes padded to a common length."""

    def __init__(self, travellers: Sequence[Traveller], right_of_way: RightOfWay) -> None:
        habits = [traveller.habits for traveller in travellers]
        routes = [traveller.route for traveller in travellers]
        longest = max(len(route.points_m) for route in routes)
        self._right_of_way = right_of_way
        self._spacing_m = routes[0].spacing_m
        self._points_m = np.stack([_padded(route.points_m, longest) for route in routes])
        self._heading_rad = np.stack([_padded(route.heading_rad, longest) for route in routes])
        self._limit_mps = np.stack([_padded(t.limit_mps, longest) for t in travellers])
        self._end_m = np.array([route.length_m for route in routes])
        self._size_m = np.array([traveller.size_m[:2] for traveller in travellers])
        self._accelerate, self._brake, self._gap_m, self._headway_s, self._side_gap_m = np.array(
            [(h.accelerate_mps2, h.brake_mps2, h.gap_m, h.headway_s, h.side_gap_m) for h in habits]
        ).T
        self._wanted_mps = np.array([traveller.speed_mps for traveller in travellers])

    def calm_speed(self, arc_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The highest speeds at which nobody need brake harder than is comfortable."""
        speed_mps = np.minimum(self._wanted_mps, self._limit_at(arc_m))
        for _ in range(int(speed_mps.max() / (self._brake.min() * DECISION_S)) + 1):
            hard = self.accelerations(0.0, arc_m, speed_mps) < -self._brake
            speed_mps = np.maximum(speed_mps - hard * self._brake * DECISION_S, 0)
        return speed_mps

    def accelerations(
        self, time_s: float, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """The Intelligent Driver Model (Treiber et al. 2000); the end of a route is a wall."""
        gap_m, lead_mps = self._ahead(arc_m, speed_mps)
        free_mps = np.maximum(np.minimum(self._wanted_mps, self._limit_at(arc_m)), 0.1)
        closing_mps = speed_mps - lead_mps
        wanted_gap_m = self._gap_m + np.maximum(
            speed_mps * self._headway_s
            + speed_mps * closing_mps / (2 * np.sqrt(self._accelerate * self._brake)),
            0,
        )
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
        """Free distance before each traveller, and how fast its end moves away."""
        front_m = arc_m + self._size_m[:, 0] / 2
        gap_m, lead_mps = look_ahead(
            self._points_m,
            self._heading_rad,
            self._index(arc_m),
            self._index(front_m),
            round(LOOK_M / self._spacing_m),
            self._size_m,
            self._side_gap_m,
            speed_mps,
        )
        to_end_m = self._end_m - front_m
        return np.minimum(gap_m, to_end_m), np.where(gap_m < to_end_m, lead_mps, 0.0)

    def _limit_at(self, arc_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Speed that the path and its turns allow there, interpolated between samples."""
        who, last = np.arange(len(arc_m)), self._limit_mps.shape[1] - 1
        at = np.clip(arc_m / self._spacing_m, 0, last)
        before, share = at.astype(int), at % 1
        after_mps = self._limit_mps[who, np.minimum(before + 1, last)]
        return (1 - share) * self._limit_mps[who, before] + share * after_mps

    def _index(self, arc_m: Float[np.ndarray, "n"]) -> np.ndarray:
        nearest = np.rint(arc_m / self._spacing_m).astype(int)
        return np.clip(nearest, 0, self._points_m.shape[1] - 1)


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])
