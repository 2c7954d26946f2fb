"""A street network (junctions and streets) and the lanes, walks and corridors that follow from it.

Every path runs from one *port* to another: a place at a junction where a street's lane, pavement or
centre line ends. The successors of a path are the paths that start at its last port.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..layout import Gate, Path
from .polyline import Polyline, arc_m, parallel, trimmed, turn
from .ways import Way, both_ways, joined

ROAD_RISE_M, JUNCTION_RISE_M, CROSSING_RISE_M, PAVEMENT_RISE_M = 0.04, 0.08, 0.12, 0.16
"""Heights of the surfaces above the terrain; neighbours differ by more than a patch can sag."""

CROSSING_OUT_M, STOP_LINE_OUT_M = 1.7, 3.8
"""Distance of a crossing's middle, and of the line before it, from where a street ends."""

KERB_STAND_M = 0.3
"""How far from the kerb people wait to cross."""

OPPOSING_RAD = np.deg2rad(45)
"""Arms that are straight on from each other, give or take this, have green together."""

WALK = WALK_HALF_WIDTH_M, WALK_MPS = 0.4, 2.5
"""A limit for bicycles; nobody walks as fast."""

LANE_HALF_WIDTH_M = 1.4
TURN_SLOWDOWN = 0.6
"""Speed on a turn, as a part of the speed on the street."""


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

    With ``signals`` all junctions have traffic lights; without, who comes first goes first.
    """

    junctions_m: Float[np.ndarray, "j 2"]
    streets: tuple[Street, ...]
    signals: bool = False

    def arms(self, junction: int) -> list[Arm]:
        """The streets at a junction, counter-clockwise."""
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

    def open_m(self, street: Street) -> Polyline:
        """A street's centre line between its junctions."""
        return trimmed(street.points_m, self.radius_m(street.start), self.radius_m(street.end))

    def lanes(self) -> tuple[Path, ...]:
        """Right-hand lanes, one per direction, joined by turns at the junctions."""
        ways = []
        for k, street in enumerate(self.streets):
            if street.profile.lane_mps is None:
                continue
            start, end = (street.start, k), (street.end, k)
            line, right = self.open_m(street), -street.profile.road_m / 4
            there, back = parallel(line, right), parallel(line[::-1], right)
            room = (LANE_HALF_WIDTH_M, street.profile.lane_mps, ROAD_RISE_M)
            gates = [self._stop_line(k, here, lane) for lane, here in ((there, end), (back, start))]
            ways.append(Way(there, ("from", *start), ("to", *end), *room, gates[0]))
            ways.append(Way(back, ("from", *end), ("to", *start), *room, gates[1]))
        return joined(ways + self._turns(ways, JUNCTION_RISE_M))

    def _stop_line(self, street: int, port: tuple[int, int], lane_m: Polyline) -> Gate:
        phase, phases = self._phases(port[0])[street]
        at_m = max(arc_m(lane_m)[-1] - STOP_LINE_OUT_M, 0.0)
        return Gate(port[0], at_m, STOP_LINE_OUT_M, False, phase, phases)

    def _phases(self, junction: int) -> dict[int, tuple[int | None, int]]:
        """For each street with lanes at a junction: its phase of the signals, of how many.

        Opposing arms share a phase. Where there is but one phase, people have another.
        """
        arms = [arm for arm in self.arms(junction) if arm.profile.lane_mps is not None]
        if not self.signals:
            return {arm.street: (None, 0) for arm in arms}
        leaders: list[Arm] = []
        phase = {}
        for arm in arms:
            facing = [k for k, other in enumerate(leaders) if _opposing(arm, other)]
            phase[arm.street] = facing[0] if facing else len(leaders)
            leaders += [] if facing else [arm]
        return {street: (k, max(len(leaders), 2)) for street, k in phase.items()}

    def corridors(self) -> tuple[Path, ...]:
        """Centre lines over the streets, both ways, joined by turns at the junctions."""
        ways = []
        for k, street in enumerate(self.streets):
            start, end = (street.start, k), (street.end, k)
            line = self.open_m(street)
            room = (street.profile.corridor_half_width_m, street.profile.corridor_mps, 0.0)
            ways.append(Way(line, ("from", *start), ("to", *end), *room))
            ways.append(Way(line[::-1], ("from", *end), ("to", *start), *room))
        return joined(ways + self._turns(ways, 0.0))

    def _turns(self, ways: Sequence[Way], rise_m: float) -> list[Way]:
        """From the end of each way at a junction to the start of every other street's there."""
        turns = []
        for come in ways:
            for go in ways:
                (_, here, street), (_, there, other) = come.end, go.start
                if here != there or street == other:
                    continue
                corner = _crossing(come.points_m[::-1], go.points_m)
                turns.append(
                    Way(
                        turn(come.points_m[-1], corner, go.points_m[0]),
                        come.end,
                        go.start,
                        min(come.half_width_m, go.half_width_m),
                        TURN_SLOWDOWN * min(come.speed_mps, go.speed_mps),
                        rise_m,
                    )
                )
        return turns

    def walks(self) -> tuple[Path, ...]:
        """Pavements on both sides, the ways around corners and the crossings, both ways."""
        ways = []
        for k, street in enumerate(self.streets):
            radii_m = (self.radius_m(street.start), self.radius_m(street.end))
            line = trimmed(street.points_m, *(radius + CROSSING_OUT_M for radius in radii_m))
            for side in (-1, 1):
                points_m = parallel(line, side * street.profile.walk_m)
                rise_m = PAVEMENT_RISE_M if street.profile.pavement_m else ROAD_RISE_M
                ports = (street.start, k, side), (street.end, k, -side)
                ways += both_ways(points_m, *ports, *WALK, rise_m)
        for junction in range(len(self.junctions_m)):
            ways += self._corners(junction) + self._crossings(junction)
        return joined(ways)

    def ports_m(
        self, junction: int, out_m: float = 0.0
    ) -> list[tuple[Arm, dict[int, Float[np.ndarray, "2"]]]]:
        """Where each arm's pavements begin: 1 is the left one as seen from the junction.

        ``out_m`` is for places on the pavements that far from there.
        """
        radius = self.radius_m(junction)
        ports = []
        for arm in self.arms(junction):
            line = trimmed(arm.points_m, radius + out_m, 0)
            sides = {side: parallel(line, side * arm.profile.walk_m)[0] for side in (-1, 1)}
            ports.append((arm, sides))
        return ports

    def _corners(self, junction: int) -> list[Way]:
        """Ways around the corners, each from one crossing to the next."""
        inner, outer = self.ports_m(junction), self.ports_m(junction, CROSSING_OUT_M)
        ways = []
        for k, (arm, here) in enumerate(inner):
            after = (k + 1) % len(inner)
            following, there = inner[after]
            corner_m = self.corner_m(arm, following, here[1], there[-1])
            points_m = np.concatenate([outer[k][1][1][None], corner_m, outer[after][1][-1][None]])
            paved = max(arm.profile.pavement_m, following.profile.pavement_m) > 0
            ports = (junction, arm.street, 1), (junction, following.street, -1)
            ways += both_ways(points_m, *ports, *WALK, PAVEMENT_RISE_M if paved else ROAD_RISE_M)
        return ways

    def _crossings(self, junction: int) -> list[Way]:
        """Ways over every arm; where vehicles come, people wait for them at the kerb."""
        phases = self._phases(junction)
        ways = []
        for arm, here in self.ports_m(junction, CROSSING_OUT_M):
            gate, profile = None, arm.profile
            if arm.street in phases:
                kerb_m = max(profile.walk_m - profile.road_m / 2 - KERB_STAND_M, 0.0)
                gate = Gate(junction, kerb_m, -kerb_m, True, *phases[arm.street])
            rise_m = CROSSING_RISE_M if profile.has_crossings else ROAD_RISE_M
            ports = (junction, arm.street, -1), (junction, arm.street, 1)
            ways += both_ways(np.stack([here[-1], here[1]]), *ports, *WALK, rise_m, gate)
        return ways

    @staticmethod
    def corner_m(
        arm: Arm,
        following: Arm,
        port_m: Float[np.ndarray, "2"],
        next_port_m: Float[np.ndarray, "2"],
    ) -> Polyline:
        """The way from an arm's left pavement to the right one of the arm that follows.

        Straight where the arms enclose less than half a turn; else around the outside of the bend,
        because the straight line would cross the road.
        """
        enclosed_rad = (following.angle_rad - arm.angle_rad) % (2 * np.pi)
        if enclosed_rad < np.deg2rad(190):
            return np.stack([port_m, next_port_m])
        a, b = (np.array([np.cos(x.angle_rad), np.sin(x.angle_rad)]) for x in (arm, following))
        bend = _crossing(np.stack([port_m, port_m + a]), np.stack([next_port_m, next_port_m + b]))
        return np.stack([port_m, bend, next_port_m])


def _opposing(one: Arm, other: Arm) -> bool:
    turned_rad = (one.angle_rad - other.angle_rad) % (2 * np.pi)
    return abs(turned_rad - np.pi) < OPPOSING_RAD


def _crossing(come_m: Polyline, go_m: Polyline) -> Float[np.ndarray, "2"]:
    """Where two ways would meet if the first were prolonged and the second began earlier."""
    a, b = come_m[0] - come_m[1], go_m[0] - go_m[1]
    gap = go_m[0] - come_m[0]
    determinant = a[0] * -b[1] + b[0] * a[1]
    if abs(determinant) < 0.2 * np.linalg.norm(a) * np.linalg.norm(b):
        return (come_m[0] + go_m[0]) / 2
    ahead = (gap[0] * -b[1] + b[0] * gap[1]) / determinant
    return come_m[0] + max(ahead, 0.0) * a
