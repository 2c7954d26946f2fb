"""Chooses the next seconds of flight: quintic primitives that stay clear of what is believed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial.polynomial import polyder

from ..errors import UserError
from ..jit import njit
from ..limits import require_at_least, require_choice, require_finite
from .belief import LEAST, MOST, BeliefMap
from .distance_field import distance_at, distances
from .vectors import Vector, apart, dot

Floats = tuple[float, ...]
# Duration, place and velocity of the end of each primitive.
Ends = Float[np.ndarray, "n 7"]

# A primitive is looked at in so many places, and how it would stop after it every half metre.
SAMPLES = 25
STOP_SAMPLE_M = 0.5
# A distance field tells no distances above this, in cells.
REACH_CELLS = 6

# Slower ends cost the way that is lost until the UAV is as fast as it likes again.
PICKS_UP_MPS2 = 2.0

# Durations of stops, as multiples of that of a constant deceleration.
STOPS = (1.3, 1.8, 2.5)

Unknown = Literal["free", "costly", "occupied"]


class Motion(NamedTuple):
    """Position, velocity and acceleration, in the world."""

    position_m: Vector
    velocity_mps: Vector
    acceleration_mps2: Vector


class Plan(NamedTuple):
    """A polynomial of the time in seconds [6, 3], lowest power first, of ``duration_s``.

    ``stops`` tells that it ends at rest. ``clear`` is false where nothing admissible was found.
    """

    coefficients: Float[np.ndarray, "6 3"]
    duration_s: float
    stops: bool
    clear: bool

    def at(self, times_s: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t 9"]:
        """Returns position, velocity and acceleration; after the end it goes straight on."""
        within_s = np.minimum(times_s, self.duration_s)[:, None]
        powers = within_s ** np.arange(6)
        rows = [powers[:, : 6 - n] @ polyder(self.coefficients, n) for n in range(3)]

        beyond_s = times_s[:, None] - within_s
        rows[0] = rows[0] + beyond_s * rows[1]
        rows[2] = np.where(beyond_s > 0, 0.0, rows[2])
        return np.concatenate(rows, axis=1)

    def after(self, passed_s: float) -> "Plan | None":
        """Returns the rest of the plan, ``None`` where less than half of that time is left."""
        left_s = self.duration_s - passed_s
        if left_s < passed_s / 2:
            return None
        # (t + passed)^k, written out.
        moved = [[math.comb(k, n) * passed_s ** max(k - n, 0) for k in range(6)] for n in range(6)]
        return self._replace(coefficients=np.array(moved) @ self.coefficients, duration_s=left_s)


class Planner(Protocol):
    """Returns a `Plan` from a motion, by a map, towards a place. ``prices`` are what plans cost by
    a map, in metres of way: infinite where one is not admissible. One that is not ``clear`` may
    exceed the limits of speed and acceleration."""

    threshold: float

    def __call__(self, motion: Motion, belief: BeliefMap, target_m: Vector) -> Plan: ...

    def prices(
        self, plans: Sequence[Plan], motion: Motion, belief: BeliefMap, target_m: Vector
    ) -> list[float]: ...


@dataclass(frozen=True)
class QuinticPlanner:
    """Takes the cheapest of many primitives from where the UAV is (Mueller, Hehn and D'Andrea,
    2015), all of which are quintic polynomials along each axis.

    A primitive is admissible if speed and acceleration stay within their limits, if what is
    believed occupied is farther away than the body's radius, half a cell's diagonal and the margin,
    and if the same holds for stopping straight on after its end. Without any, the one that stops
    and stays farthest from everything is taken.

    ``threshold`` is the probability from which a cell counts as occupied: the one knob. Cells of
    which nothing is known are ``unknown``: free, occupied or, for a price, free.

    With ``stops_in_known`` a primitive, and the way to stop after it, must not leave the cells that
    were seen: so it is as fast as it sees far. With ``keeps_stops`` the way to stop is that of the
    hardest stop that it has, and not the shorter one of ``brake_mps2``; and without any primitive
    it takes one of these. Raises `UserError` for settings out of range.
    """

    cruise_mps: float = 6.0
    threshold: float = 0.5
    unknown: Unknown = "costly"
    stops_in_known: bool = False
    keeps_stops: bool = False
    radius_m: float = 0.3
    margin_m: float = 0.1
    acceleration_mps2: float = 6.0
    brake_mps2: float = 4.0
    bearings_deg: Floats = (-75, -60, -48, -37, -27, -18, -9, 0, 9, 18, 27, 37, 48, 60, 75)
    elevations_deg: Floats = (-30, -20, -12, -5, 0, 8, 18, 30)
    end_speeds: Floats = (0.3, 0.55, 0.8, 1.0)  # shares of the cruise speed
    durations_s: Floats = (1.0, 1.6, 2.2)
    # Prices, in metres of way.
    height: float = 0.5  # a metre off the wanted height
    closeness: float = 6.0  # a second at no distance
    unknown_price: float = 3.0  # a second through what is unknown
    jerk: float = 0.003  # a second at 1 m/s3, squared
    detour: float = 3.0  # a metre that is blocked of the straight way from the end to the target

    def __post_init__(self) -> None:
        require_choice("planner.unknown", self.unknown, get_args(Unknown))
        numbers = [name for name, value in vars(self).items() if type(value) in (int, float)]
        require_at_least(0, "planner", vars(self), *numbers)
        for name, value in (
            ("brake_mps2", self.brake_mps2),
            ("durations_s", min(self.durations_s)),
        ):
            require_finite(f"planner.{name}", value)

        least, most = (1 / (1 + math.exp(-odds)) for odds in (LEAST, MOST))
        if not least <= self.threshold < most:
            raise UserError(
                f"planner.threshold: {self.threshold}; the map knows no probabilities outside "
                f"{least:.2f} to {most:.2f}, give one between"
            )
        if not self.cruise_mps > 0:
            raise UserError(f"planner.cruise_mps: {self.cruise_mps}; give a speed above 0")

    def __call__(self, motion: Motion, belief: BeliefMap, target_m: Vector) -> Plan:
        ends, stops = self._ends(motion, target_m)
        costs, clearances_m = self._judged(ends, motion, belief, target_m)
        best, clear = int(costs.argmin()), True
        if not math.isfinite(costs[best]):
            if self.keeps_stops:
                stops &= ends[:, 0] == ends[stops, 0].min()
            best, clear = int(np.where(stops, clearances_m, -1.0).argmax()), False
        return Plan(_quintic(*motion, ends[best]), ends[best, 0], bool(stops[best]), clear)

    def prices(
        self, plans: Sequence[Plan], motion: Motion, belief: BeliefMap, target_m: Vector
    ) -> list[float]:
        last = np.stack([plan.at(np.array([plan.duration_s]))[0, :6] for plan in plans])
        # A polynomial stops to fifteen digits, and whether one stops decides.
        last[[plan.stops for plan in plans], 3:] = 0.0
        ends = np.column_stack([[plan.duration_s for plan in plans], last])
        limited = all(plan.clear for plan in plans)
        return self._judged(ends, motion, belief, target_m, limited)[0].tolist()

    def _judged(
        self, ends: Ends, motion: Motion, belief: BeliefMap, target_m: Vector, limited: bool = True
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Returns the price of every primitive, and its clearance in metres."""
        occupied = belief.occupied(self.threshold)
        if self.unknown == "occupied":
            occupied |= ~belief.seen
        lattice = belief.lower_m, belief.cell_m
        field_m = distances(occupied, REACH_CELLS) * np.float32(belief.cell_m)

        need_m = self.radius_m + self.margin_m + belief.cell_m * math.sqrt(3) / 2
        most = (1.15 * self.cruise_mps, self.acceleration_mps2) if limited else (math.inf, math.inf)
        # A stop takes longer than one of constant deceleration.
        brake_mps2 = self.brake_mps2 / (STOPS[0] if self.keeps_stops else 1.0)
        limits = *most, brake_mps2, need_m, self.stops_in_known
        unknown = self.unknown_price if self.unknown == "costly" else 0.0
        prices = self.cruise_mps, self.height, self.closeness, unknown, self.jerk, self.detour
        return _judge(ends, *motion, target_m, field_m, belief.seen, *lattice, limits, prices)

    def _ends(self, motion: Motion, target_m: Vector) -> tuple[Ends, Bool[np.ndarray, "n"]]:
        """Returns the ends of all primitives, and which stop.

        Directions are seen from the way to the target. A primitive is as long as with a steady
        change of speed.
        """
        speed_mps = float(np.linalg.norm(motion.velocity_mps))
        ahead = _direction(target_m - motion.position_m)
        flights = self._grid + np.array([*ahead, 0.0, 0.0])

        # Stops go the way that the UAV goes, and to both sides of it.
        course_rad, slope_rad = _direction(motion.velocity_mps) if speed_mps > 0.1 else ahead
        halts = _combined(
            np.radians((-50, -25, 0, 25, 50)) + course_rad,
            np.array((-0.3, 0.0, 0.3)) + slope_rad,
            np.zeros(1),
            max(speed_mps / self.brake_mps2, 0.3) * np.array(STOPS),
        )
        bearing, slope, speeds, durations_s = np.concatenate([flights, halts]).T
        ways = np.stack(
            [np.cos(slope) * np.cos(bearing), np.cos(slope) * np.sin(bearing), np.sin(slope)],
            axis=1,
        )
        length_m = durations_s * (speed_mps + speeds) / 2
        ends = np.column_stack(
            [durations_s, motion.position_m + length_m[:, None] * ways, speeds[:, None] * ways]
        )
        return ends, speeds == 0

    @cached_property
    def _grid(self) -> Float[np.ndarray, "n 4"]:
        """Bearing, elevation, end speed and duration of every primitive that goes on."""
        return _combined(
            np.radians(self.bearings_deg),
            np.radians(self.elevations_deg),
            self.cruise_mps * np.array(self.end_speeds),
            np.array(self.durations_s, dtype=float),
        )


def _direction(vector: Vector) -> tuple[float, float]:
    """Returns bearing and elevation of a vector in radians."""
    x, y, z = vector
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


def _combined(*axes: np.ndarray) -> np.ndarray:
    return np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")], axis=1)


@njit
def _quintic(position, velocity, acceleration, end):
    """Returns the polynomial from a motion to an end; the acceleration there is zero."""
    t, coefficients = end[0], np.empty((6, 3))
    for a in range(3):
        p, v, half = position[a], velocity[a], acceleration[a] / 2
        gap = end[1 + a] - p - v * t - half * t * t
        change = end[4 + a] - v - 2 * half * t
        bend = -2 * half
        coefficients[0, a], coefficients[1, a], coefficients[2, a] = p, v, half
        coefficients[3, a] = (10 * gap - 4 * change * t + 0.5 * bend * t * t) / t**3
        coefficients[4, a] = (-15 * gap + 7 * change * t - bend * t * t) / t**4
        coefficients[5, a] = (6 * gap - 3 * change * t + 0.5 * bend * t * t) / t**5
    return coefficients


@njit
def _judge(
    ends, position, velocity, acceleration, target, field, seen, lower, cell, limits, prices
):
    """Returns the price of every primitive, inf where it is not admissible, and its clearance.

    Clearance is not computed for rejected primitives that do not stop.
    """
    costs, clearances = np.full(len(ends), np.inf), np.zeros(len(ends))
    fastest, hardest, brake, need, in_known = limits
    cruise, of_height, of_closeness, of_unknown, of_jerk, of_detour = prices
    # Where the UAV is too near already, it must get away.
    here = distance_at(field, (position - lower) / cell)
    first = min(need, max(here - 0.05, 0.0))
    # Taken once: an expression of arrays would take new ones for every sample.
    place, speed, push, jerk, index = np.empty((5, 3))

    for n in range(len(ends)):
        duration, end, end_velocity = ends[n, 0], ends[n, 1:4], ends[n, 4:]
        c = _quintic(position, velocity, acceleration, ends[n])
        price, nearest, possible, entered = 0.0, np.inf, True, False
        pace = np.sqrt(dot(end_velocity, end_velocity))
        for s in range(1, SAMPLES + 1):
            t = duration * s / SAMPLES
            for a in range(3):
                c0, c1, c2, c3, c4, c5 = c[0, a], c[1, a], c[2, a], c[3, a], c[4, a], c[5, a]
                place[a] = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
                speed[a] = c1 + t * (2 * c2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)))
                push[a] = 2 * c2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))
                jerk[a] = 6 * c3 + t * (24 * c4 + t * 60 * c5)
                index[a] = (place[a] - lower[a]) / cell
            too_fast = (
                dot(speed, speed) > max(fastest, 1.02 * np.sqrt(dot(velocity, velocity))) ** 2
            )
            if too_fast or dot(push, push) > hardest**2:
                possible = False
            if not possible and pace > 0:
                break

            clearance, is_seen = distance_at(field, index), _is_seen(seen, index)
            nearest = min(nearest, clearance)
            if clearance < min(need, first + 0.5 * apart(place, position)):
                possible = False
            # It begins where the camera has not seen, and once it has left that it stays out.
            entered = entered or is_seen
            if in_known and entered and not is_seen:
                possible = False
            step = duration / SAMPLES
            price += of_jerk * dot(jerk, jerk) * step
            price += of_closeness * max(0.0, 1.0 - (clearance - need) / 1.5) ** 2 * step
            if of_unknown > 0 and not is_seen:
                price += of_unknown * step

        if not possible and pace > 0:
            continue
        # After its end it must be able to stop straight on.
        way = pace * pace / (2 * brake)
        for s in range(1, int(np.ceil(way / STOP_SAMPLE_M)) + 1):
            further = min(s * STOP_SAMPLE_M, way)
            for a in range(3):
                index[a] = (end[a] + end_velocity[a] / pace * further - lower[a]) / cell
            clearance = distance_at(field, index)
            nearest = min(nearest, clearance)
            if clearance < need:
                possible = False
            if in_known and not _is_seen(seen, index):
                possible = False
        clearances[n] = nearest
        if possible:
            # What is left of the way, the time taken, and what it takes to be fast again.
            price += apart(target, end) + cruise * duration
            price += (cruise - pace) ** 2 / (2 * PICKS_UP_MPS2)
            price += of_detour * _blocked_m(field, end, target, lower, cell, need)
            costs[n] = price + of_height * abs(end[2] - target[2])
    return costs, clearances


@njit
def _blocked_m(field, start, target, lower, cell, need):
    """Returns the metres of a straight way that are too near to what is occupied."""
    length = apart(target, start)
    steps = int(np.ceil(length / STOP_SAMPLE_M))
    blocked, index = 0, np.empty(3)
    for s in range(1, steps + 1):
        for a in range(3):
            index[a] = (start[a] + (target[a] - start[a]) * (s / steps) - lower[a]) / cell
        if distance_at(field, index) < need:
            blocked += 1
    return blocked * length / max(steps, 1)


@njit
def _is_seen(seen, place):
    i, j, k = int(np.floor(place[0])), int(np.floor(place[1])), int(np.floor(place[2]))
    if not (0 <= i < seen.shape[0] and 0 <= j < seen.shape[1] and 0 <= k < seen.shape[2]):
        return False
    return seen[i, j, k]
