"""A street network (junctions and streets) and the lanes, walks and corridors that follow from it.

Every path runs from one *port* to another: a place at a junction where a street's lane, pavement or
center line ends. The successors of a path are the paths that start at its last port.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..layout import Gate, Path
from ..solid import Rng
from .polyline import Point, Polyline, arc_m, crossing, parallel, trimmed, turn
from .ways import Way, joined

Pairs = Iterable[tuple[int, int]]

# Heights of the surfaces above the terrain; neighbours differ by more than a patch can sag.
ROAD_RISE_M, JUNCTION_RISE_M, CROSSING_RISE_M, PAVEMENT_RISE_M = 0.04, 0.08, 0.12, 0.16

# Distance of a crossing's middle, and of the line before it, from where a street ends; and how far
# from the kerb people wait to cross.
CROSSING_OUT_M, STOP_LINE_OUT_M, KERB_STAND_M = 1.7, 3.8, 0.3

# Arms that are straight on from each other, give or take this, have green together.
OPPOSING_RAD = np.deg2rad(45)

# The speed is a limit for bicycles; nobody walks as fast.
WALK_HALF_WIDTH_M, WALK_MPS = 0.4, 2.5

# The slowdown is the speed on a turn, as a part of the speed on the street.
LANE_HALF_WIDTH_M = 1.4
TURN_SLOWDOWN = 0.6


@dataclass(frozen=True)
class Profile:
    """The cross-section of a street: a road between two pavements, and what may move there.

    A way without vehicles has no ``lane_mps``; without pavements people walk on the road itself.
    """

    road_m: float
    road: str
    pavement_m: float
    pavement: str
    lane_mps: float | None
    corridor_half_width_m: float
    corridor_mps: float

    @property
    def half_m(self) -> float:
        return self.road_m / 2 + self.pavement_m

    @property
    def has_crossings(self) -> bool:
        """Whether zebra crossings are painted at its ends."""
        return self.road.startswith("road")

    @property
    def walk_m(self) -> float:
        """Distance of the walking line from the middle of the street."""
        return self.road_m / 2 + 0.75 * self.pavement_m if self.pavement_m else self.road_m / 4


@dataclass(frozen=True)
class Street:
    """A street from the middle of one junction to the middle of another."""

    start: int
    end: int
    points_m: Polyline
    profile: Profile


def straight(junctions_m: Polyline, pairs: Pairs, profile: Profile) -> tuple[Street, ...]:
    """Streets in straight lines between pairs of junctions."""
    return tuple(Street(a, b, junctions_m[[a, b]], profile) for a, b in pairs)


def bowed(
    rng: Rng, junctions_m: Polyline, pairs: Pairs, profile: Profile, bow_m: tuple[float, float]
) -> tuple[Street, ...]:
    """Streets that curve to either side; ``bow_m`` bounds how far aside the control point lies."""
    streets = []
    for start, end in pairs:
        a, b = junctions_m[start], junctions_m[end]
        across = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        bow = rng.choice([-1, 1]) * rng.uniform(*bow_m)
        streets.append(Street(start, end, turn(a, (a + b) / 2 + bow * across, b, 9), profile))
    return tuple(streets)


@dataclass(frozen=True)
class Arm:
    """A street as one of its junctions sees it: ``points_m`` lead away from the junction."""

    street: int
    points_m: Polyline
    profile: Profile

    @property
    def angle_rad(self) -> float:
        dx, dy = self.points_m[1] - self.points_m[0]
        return float(np.arctan2(dy, dx))


@dataclass(frozen=True)
class Network:
    """Junctions and the streets between them; at each junction at least two streets meet.

    With ``lights`` all junctions have traffic lights; without, who comes first goes first.
    """

    junctions_m: Polyline
    streets: tuple[Street, ...]
    lights: bool = False

    def arms(self, junction: int) -> list[Arm]:
        """Returns the streets at a junction, counter-clockwise."""
        arms = []
        for k, street in enumerate(self.streets):
            if street.start == junction:
                arms.append(Arm(k, street.points_m, street.profile))
            if street.end == junction:
                arms.append(Arm(k, street.points_m[::-1], street.profile))
        return sorted(arms, key=lambda arm: arm.angle_rad)

    def radius_m(self, junction: int) -> float:
        """How far from its middle a junction's streets begin: pavements must not overlap there."""
        arms = self.arms(junction)
        angles = np.array([arm.angle_rad for arm in arms])
        gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
        half = max(arm.profile.half_m for arm in arms)
        return half / np.tan(min(gaps.min(), np.pi / 2) / 2) + 0.5

    def open_m(self, street: Street, out_m: float = 0.0) -> Polyline:
        """Returns a street's center line between its junctions, ``out_m`` shorter at both ends."""
        radii_m = self.radius_m(street.start), self.radius_m(street.end)
        return trimmed(street.points_m, radii_m[0] + out_m, radii_m[1] + out_m)

    def lanes(self) -> tuple[Path, ...]:
        """Right-hand lanes, one per direction, joined by turns at the junctions."""
        ways = []
        for k, line_m, start, end in self._directions():
            profile, junction = self.streets[k].profile, end[1]
            if profile.lane_mps is not None:
                lane_m = parallel(line_m, -profile.road_m / 4)
                stop_m = max(arc_m(lane_m)[-1] - STOP_LINE_OUT_M, 0.0)
                gate = Gate(junction, stop_m, STOP_LINE_OUT_M, False, *self._phases(junction)[k])
                room = (LANE_HALF_WIDTH_M, profile.lane_mps)
                ways.append(Way(Path(lane_m, *room, (), ROAD_RISE_M, gate), start, end))
        return joined(ways + self._turns(ways, JUNCTION_RISE_M))

    def corridors(self) -> tuple[Path, ...]:
        """Center lines over the streets, both ways, joined by turns at the junctions."""
        ways = []
        for k, line_m, start, end in self._directions():
            profile = self.streets[k].profile
            room = (profile.corridor_half_width_m, profile.corridor_mps)
            ways.append(Way(Path(line_m, *room, ()), start, end))
        return joined(ways + self._turns(ways, 0.0))

    def _directions(self) -> Iterator[tuple[int, Polyline, tuple, tuple]]:
        """Yields each street's number, open line, first and last port, there and back."""
        for k, street in enumerate(self.streets):
            line_m = self.open_m(street)
            yield k, line_m, ("from", street.start, k), ("to", street.end, k)
            yield k, line_m[::-1], ("from", street.end, k), ("to", street.start, k)

    def _phases(self, junction: int) -> dict[int, tuple[int | None, int]]:
        """For each street with lanes at a junction: its phase of the lights, of how many.

        Opposing arms share a phase. Where there is but one phase, people have another.
        """
        arms = [arm for arm in self.arms(junction) if arm.profile.lane_mps is not None]
        if not self.lights:
            return {arm.street: (None, 0) for arm in arms}

        leaders: list[Arm] = []
        phase = {}
        for arm in arms:
            facing = [k for k, other in enumerate(leaders) if _opposing(arm, other)]
            phase[arm.street] = facing[0] if facing else len(leaders)
            if not facing:
                leaders.append(arm)
        return {street: (k, max(len(leaders), 2)) for street, k in phase.items()}

    def _turns(self, ways: Sequence[Way], rise_m: float) -> list[Way]:
        """Ways from the end of each way at a junction to the start of every other street there."""
        turns = []
        for come in ways:
            for go in ways:
                (_, junction, street), (_, next_junction, next_street) = come.end, go.start
                if junction != next_junction or street == next_street:
                    continue

                # A turn bends where the two ways would cross, and is as narrow as the narrower.
                here, onward = come.path, go.path
                corner_m = crossing(here.points_m[::-1], onward.points_m)
                points_m = turn(here.points_m[-1], corner_m, onward.points_m[0])
                half_m = min(here.half_width_m, onward.half_width_m)
                speed_mps = TURN_SLOWDOWN * min(here.speed_mps, onward.speed_mps)
                path = Path(points_m, half_m, speed_mps, (), rise_m)
                turns.append(Way(path, come.end, go.start))
        return turns

    def walks(self) -> tuple[Path, ...]:
        """Pavements on both sides, the ways around corners and the crossings, both ways."""
        ways = []
        for k, street in enumerate(self.streets):
            # Pavements end at the crossings, which lie a little way into the street.
            line = self.open_m(street, CROSSING_OUT_M)
            rise_m = PAVEMENT_RISE_M if street.profile.pavement_m else ROAD_RISE_M
            for side in (-1, 1):
                points_m = parallel(line, side * street.profile.walk_m)
                ports = (street.start, k, side), (street.end, k, -side)
                ways += _both_ways(points_m, *ports, rise_m)

        for junction in range(len(self.junctions_m)):
            ways += self._corners(junction) + self._crossings(junction)
        return joined(ways)

    def corners(self, junction: int) -> Iterator[tuple[Arm, Arm, Polyline]]:
        """Yields each arm, the arm that follows, and the way between their pavements around the
        corner.

        It is straight where the arms enclose less than half a turn; else it leads around the
        outside of the bend, because the straight line would cross the road.
        """
        arms = self.arms(junction)
        for arm, following in zip(arms, arms[1:] + arms[:1]):
            left_m, right_m = self._port_m(junction, arm, 1), self._port_m(junction, following, -1)
            way_m = [left_m, right_m]

            enclosed_rad = (following.angle_rad - arm.angle_rad) % (2 * np.pi)
            if enclosed_rad >= np.deg2rad(190):
                a, b = (
                    np.array([np.cos(x.angle_rad), np.sin(x.angle_rad)]) for x in (arm, following)
                )
                bend_m = crossing(np.stack([left_m, left_m + a]), np.stack([right_m, right_m + b]))
                way_m.insert(1, bend_m)
            yield arm, following, np.stack(way_m)

    def _port_m(self, junction: int, arm: Arm, side: int, out_m: float = 0.0) -> Point:
        """Returns where a pavement of an arm begins: 1 is the left one as seen from the junction.

        ``out_m`` is for a place on the pavement that far from there.
        """
        line_m = trimmed(arm.points_m, self.radius_m(junction) + out_m, 0)
        return parallel(line_m, side * arm.profile.walk_m)[0]

    def _corners(self, junction: int) -> list[Way]:
        """Ways around the corners, each from one crossing to the next."""
        ways = []
        for arm, following, corner_m in self.corners(junction):
            start_m = self._port_m(junction, arm, 1, CROSSING_OUT_M)
            end_m = self._port_m(junction, following, -1, CROSSING_OUT_M)
            points_m = np.concatenate([start_m[None], corner_m, end_m[None]])

            paved = max(arm.profile.pavement_m, following.profile.pavement_m) > 0
            rise_m = PAVEMENT_RISE_M if paved else ROAD_RISE_M
            ports = (junction, arm.street, 1), (junction, following.street, -1)
            ways += _both_ways(points_m, *ports, rise_m)
        return ways

    def _crossings(self, junction: int) -> list[Way]:
        """Ways over every arm; where vehicles come, people wait for them at the kerb."""
        phases = self._phases(junction)
        ways = []
        for arm in self.arms(junction):
            gate, profile = None, arm.profile
            if arm.street in phases:
                kerb_m = max(profile.walk_m - profile.road_m / 2 - KERB_STAND_M, 0.0)
                gate = Gate(junction, kerb_m, -kerb_m, True, *phases[arm.street])

            rise_m = CROSSING_RISE_M if profile.has_crossings else ROAD_RISE_M
            ports = (junction, arm.street, -1), (junction, arm.street, 1)
            ends_m = [self._port_m(junction, arm, side, CROSSING_OUT_M) for side in (-1, 1)]
            ways += _both_ways(np.stack(ends_m), *ports, rise_m, gate)
        return ways


def _both_ways(
    points_m: Polyline, start: tuple, end: tuple, rise_m: float, gate: Gate | None = None
) -> list[Way]:
    """A walk and the same way back."""
    room = (WALK_HALF_WIDTH_M, WALK_MPS, (), rise_m, gate)
    return [Way(Path(points_m, *room), start, end), Way(Path(points_m[::-1], *room), end, start)]


def _opposing(one: Arm, other: Arm) -> bool:
    turned_rad = (one.angle_rad - other.angle_rad) % (2 * np.pi)
    return abs(turned_rad - np.pi) < OPPOSING_RAD
