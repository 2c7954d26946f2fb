"""How road users drive, ride and walk: their habits, and the Intelligent Driver Model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from .route import Route, braked

DECISION_S = 0.1
"""Accelerations are chosen this often and held in between."""

SIGHT_M = 30.0
EMERGENCY_MPS2 = 8.0
SIDE_GAP_M = 0.2


@dataclass(frozen=True)
class Habits:
    """What a type of actor wants. Speeds are also limited by the path and by ``turn_radps``."""

    speed_mps: tuple[float, float]
    accelerate_mps2: float
    brake_mps2: float
    gap_m: float
    """Kept to whatever is ahead when standing."""
    headway_s: float
    turn_radps: float
    corner_m: float
    """How widely corners are cut: see `Route.through`."""


HABITS: Final = {
    "bus": Habits((5.0, 9.0), 1.0, 2.0, 2.0, 1.4, 0.6, 4.0),
    "truck": Habits((5.0, 10.0), 1.1, 2.0, 2.0, 1.4, 0.6, 3.5),
    "car": Habits((6.0, 13.0), 1.8, 2.5, 2.0, 1.2, 0.8, 3.0),
    "motorcycle": Habits((6.0, 13.0), 2.2, 2.5, 1.5, 1.0, 0.9, 2.5),
    "bicycle": Habits((3.0, 5.5), 1.0, 2.0, 1.0, 1.0, 1.0, 1.5),
    "pedestrian": Habits((0.9, 1.7), 1.0, 2.0, 0.4, 0.4, 1.5, 0.5),
}


@dataclass(frozen=True)
class Traveller:
    """Someone at a place of a route, with the speed wanted where nothing is in the way."""

    type: str
    size_m: tuple[float, float, float]
    route: Route
    start_m: float
    speed_mps: float

    @cached_property
    def start(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, ""]]:
        """Position and heading at the start."""
        return self.route.at(self.start_m)


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


def drive(travellers: Sequence[Traveller], duration_s: float) -> Motion:
    """All travellers along their routes, each minding what is ahead on its own."""
    crowd = _Crowd(travellers)
    steps = int(np.ceil(duration_s / DECISION_S)) + 1
    arcs_m, speeds_mps, accelerations_mps2 = np.zeros((3, steps, len(travellers)))
    arc_m = np.array([traveller.start_m for traveller in travellers])
    speed_mps = np.minimum(crowd.wanted_mps, crowd.limit_at(arc_m))
    for k in range(steps):
        acceleration_mps2 = crowd.accelerations(arc_m, speed_mps)
        arcs_m[k], speeds_mps[k], accelerations_mps2[k] = arc_m, speed_mps, acceleration_mps2
        arc_m = arc_m + speed_mps * DECISION_S + 0.5 * acceleration_mps2 * DECISION_S**2
        speed_mps = np.maximum(speed_mps + acceleration_mps2 * DECISION_S, 0)
    return Motion(arcs_m, speeds_mps, accelerations_mps2)


class _Crowd:
    """The travellers' routes and habits as arrays, routes padded to a common length."""

    def __init__(self, travellers: Sequence[Traveller]) -> None:
        habits = [HABITS[traveller.type] for traveller in travellers]
        routes = [traveller.route for traveller in travellers]
        longest = max(len(route.points_m) for route in routes)
        self._spacing_m = routes[0].spacing_m
        self._points_m = np.stack([_padded(route.points_m, longest) for route in routes])
        self._heading_rad = np.stack([_padded(route.heading_rad, longest) for route in routes])
        self._limit_mps = np.stack(
            [_padded(_speed_limit(*pair), longest) for pair in zip(routes, habits)]
        )
        self._end_m = np.array([route.length_m for route in routes])
        self._length_m, self._width_m, _ = np.array([t.size_m for t in travellers]).T
        self._accelerate, self._brake, self._gap_m, self._headway_s = np.array(
            [(h.accelerate_mps2, h.brake_mps2, h.gap_m, h.headway_s) for h in habits]
        ).T
        self.wanted_mps = np.array([traveller.speed_mps for traveller in travellers])

    def limit_at(self, arc_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Speed that the path and its turns allow there."""
        return self._limit_mps[np.arange(len(arc_m)), self._index(arc_m)]

    def accelerations(
        self, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """The Intelligent Driver Model (Treiber et al. 2000); the end of a route is a wall."""
        gap_m, closing_mps = self._ahead(arc_m, speed_mps)
        free_mps = np.maximum(np.minimum(self.wanted_mps, self.limit_at(arc_m)), 0.1)
        wanted_gap_m = self._gap_m + np.maximum(
            speed_mps * self._headway_s
            + speed_mps * closing_mps / (2 * np.sqrt(self._accelerate * self._brake)),
            0,
        )
        wish = 1 - (speed_mps / free_mps) ** 4 - (wanted_gap_m / np.maximum(gap_m, 0.1)) ** 2
        # The model only drifts towards a lower limit; a turn must be met in time.
        next_limit_mps = self.limit_at(arc_m + speed_mps * DECISION_S)
        wanted = np.minimum(self._accelerate * wish, (next_limit_mps - speed_mps) / DECISION_S)
        hardest = np.minimum(EMERGENCY_MPS2, speed_mps / DECISION_S)
        return np.clip(wanted, -hardest, self._accelerate)

    def _ahead(
        self, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Free distance before each traveller, and how fast it shrinks."""
        here = np.arange(len(arc_m)), self._index(arc_m)
        position_m, heading_rad = self._points_m[here], self._heading_rad[here]
        forward = np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=1)
        gap_m = self._end_m - arc_m - self._length_m / 2
        closing_mps = speed_mps.copy()
        me, other = self._neighbours(position_m, forward)
        distance_m, tangent, is_ahead = self._along_the_way(me, other, arc_m, position_m, forward)
        leads_mps = (forward[other] * tangent).sum(axis=1) * speed_mps[other]
        for i, d, lead_mps in zip(me[is_ahead], distance_m[is_ahead], leads_mps[is_ahead]):
            if d < gap_m[i]:
                gap_m[i], closing_mps[i] = d, speed_mps[i] - lead_mps
        return gap_m, closing_mps

    def _neighbours(
        self, position_m: Float[np.ndarray, "n 2"], forward: Float[np.ndarray, "n 2"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (me, other) of which the other may be in sight: near, and not behind me."""
        offset_m = position_m[None] - position_m[:, None]
        half_m = (self._length_m[:, None] + self._length_m[None]) / 2
        near = np.hypot(*np.moveaxis(offset_m, -1, 0)) < SIGHT_M + half_m
        near &= (offset_m * forward[:, None]).sum(axis=-1) > -half_m
        np.fill_diagonal(near, False)
        return np.nonzero(near)

    def _along_the_way(
        self,
        me: np.ndarray,
        other: np.ndarray,
        arc_m: Float[np.ndarray, "n"],
        position_m: Float[np.ndarray, "n 2"],
        forward: Float[np.ndarray, "n 2"],
    ) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p 2"], Bool[np.ndarray, "p"]]:
        """For pairs: distance from my front to the other, my direction there, if it is in my way.

        The other is three discs as wide as it is, along its length.
        """
        way_m = np.arange(0, SIGHT_M, 1.0)
        front_m = arc_m + self._length_m / 2
        index = self._index((front_m[me])[:, None] + way_m)
        way_points_m = self._points_m[me[:, None], index]
        half_m = np.maximum(self._length_m - self._width_m, 0) / 2
        reach_m = half_m[:, None] * np.array([-1.0, 0.0, 1.0])
        discs_m = position_m[:, None] + reach_m[..., None] * forward[:, None]
        offset_m = discs_m[other][:, None] - way_points_m[:, :, None]
        apart_m = np.hypot(offset_m[..., 0], offset_m[..., 1])
        nearest = apart_m.argmin(axis=1)
        pair, disc = np.arange(len(me))[:, None], np.arange(3)[None]
        heading_rad = self._heading_rad[me[:, None], index][pair, nearest]
        tangent = np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=-1)
        beyond_m = (offset_m[pair, nearest, disc] * tangent).sum(axis=-1)
        side_m = np.abs(np.cross(tangent, offset_m[pair, nearest, disc]))
        along_m = way_m[nearest] + beyond_m
        in_way = side_m < (self._width_m[me] + self._width_m[other])[:, None] / 2 + SIDE_GAP_M
        in_way &= (along_m > 0) & (along_m < SIGHT_M)
        gap_m = np.where(in_way, along_m - self._width_m[other][:, None] / 2, np.inf)
        first = gap_m.argmin(axis=1)
        rows = np.arange(len(me))
        return gap_m[rows, first], tangent[rows, first], in_way.any(axis=1)

    def _index(self, arc_m: Float[np.ndarray, "*n"]) -> np.ndarray:
        nearest = np.rint(arc_m / self._spacing_m).astype(int)
        return np.clip(nearest, 0, self._points_m.shape[1] - 1)


def _speed_limit(route: Route, habits: Habits) -> Float[np.ndarray, "n"]:
    turn_mps = habits.turn_radps / np.maximum(route.sharpness(), 1e-6)
    return braked(np.minimum(route.speed_mps, turn_mps), route.spacing_m, habits.brake_mps2)


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])
