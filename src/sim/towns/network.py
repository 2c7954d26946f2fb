"""A street network (junctions and streets) and the lanes, walks and corridors that follow from it.

Every path runs from one *port* to another: a place at a junction where a street's lane, pavement or
centre line ends. The successors of a path are the paths that start at its last port.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..layout import Path
from .polyline import Polyline, parallel, trimmed, turn

ROAD_RISE_M, JUNCTION_RISE_M, CROSSING_RISE_M, PAVEMENT_RISE_M = 0.04, 0.08, 0.12, 0.16
"""Heights of the surfaces above the terrain; neighbours differ by more than a patch can sag."""

WALK_MPS = 1.4
WALK_HALF_WIDTH_M = 0.4
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
        return self.road_m / 2 + 0.62 * self.pavement_m if self.pavement_m else self.road_m / 4


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
    """Junctions and the streets between them; at each junction at least two streets meet."""

    junctions_m: Float[np.ndarray, "j 2"]
    streets: tuple[Street, ...]

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
            ways.append(_Way(there, ("from", *start), ("to", *end), *room))
            ways.append(_Way(back, ("from", *end), ("to", *start), *room))
        return _joined(ways + self._turns(ways, JUNCTION_RISE_M))

    def corridors(self) -> tuple[Path, ...]:
        """Centre lines over the streets, both ways, joined by turns at the junctions."""
        ways = []
        for k, street in enumerate(self.streets):
            start, end = (street.start, k), (street.end, k)
            line = self.open_m(street)
            room = (street.profile.corridor_half_width_m, street.profile.corridor_mps, 0.0)
            ways.append(_Way(line, ("from", *start), ("to", *end), *room))
            ways.append(_Way(line[::-1], ("from", *end), ("to", *start), *room))
        return _joined(ways + self._turns(ways, 0.0))

    def _turns(self, ways: Sequence["_Way"], rise_m: float) -> list["_Way"]:
        """From the end of each way at a junction to the start of every other street's there."""
        turns = []
        for come in ways:
            for go in ways:
                (_, here, street), (_, there, other) = come.end, go.start
                if here != there or street == other:
                    continue
                corner = _crossing(come.points_m[::-1], go.points_m)
                turns.append(
                    _Way(
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
        lines = []
        for k, street in enumerate(self.streets):
            for side in (-1, 1):
                points = parallel(self.open_m(street), side * street.profile.walk_m)
                rise_m = PAVEMENT_RISE_M if street.profile.pavement_m else ROAD_RISE_M
                lines.append((points, (street.start, k, side), (street.end, k, -side), rise_m))
        for junction in range(len(self.junctions_m)):
            lines += self._crossings(junction)
        ways = []
        for points, start, end, rise_m in lines:
            ways.append(_Way(points, start, end, WALK_HALF_WIDTH_M, WALK_MPS, rise_m))
            ways.append(_Way(points[::-1], end, start, WALK_HALF_WIDTH_M, WALK_MPS, rise_m))
        return _joined(ways)

    def ports_m(self, junction: int) -> list[tuple[Arm, dict[int, Float[np.ndarray, "2"]]]]:
        """Where each arm's pavements begin: 1 is the left one as seen from the junction."""
        radius = self.radius_m(junction)
        ports = []
        for arm in self.arms(junction):
            line = trimmed(arm.points_m, radius, 0)
            sides = {side: parallel(line, side * arm.profile.walk_m)[0] for side in (-1, 1)}
            ports.append((arm, sides))
        return ports

    def _crossings(self, junction: int) -> list[tuple[Polyline, Hashable, Hashable, float]]:
        """Ways over every arm and around every corner: line, ports, and how high it lies."""
        ports = self.ports_m(junction)
        lines = []
        for (arm, here), (following, there) in zip(ports, ports[1:] + ports[:1]):
            left, right = (junction, arm.street, 1), (junction, arm.street, -1)
            rise_m = CROSSING_RISE_M if arm.profile.has_crossings else ROAD_RISE_M
            lines.append((np.stack([here[-1], here[1]]), right, left, rise_m))
            corner = self.corner_m(arm, following, here[1], there[-1])
            paved = max(arm.profile.pavement_m, following.profile.pavement_m) > 0
            rise_m = PAVEMENT_RISE_M if paved else ROAD_RISE_M
            lines.append((corner, left, (junction, following.street, -1), rise_m))
        return lines

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


@dataclass(frozen=True)
class _Way:
    points_m: Polyline
    start: Hashable
    end: Hashable
    half_width_m: float
    speed_mps: float
    rise_m: float


def _crossing(come_m: Polyline, go_m: Polyline) -> Float[np.ndarray, "2"]:
    """Where two ways would meet if the first were prolonged and the second began earlier."""
    a, b = come_m[0] - come_m[1], go_m[0] - go_m[1]
    gap = go_m[0] - come_m[0]
    determinant = a[0] * -b[1] + b[0] * a[1]
    if abs(determinant) < 0.2 * np.linalg.norm(a) * np.linalg.norm(b):
        return (come_m[0] + go_m[0]) / 2
    ahead = (gap[0] * -b[1] + b[0] * gap[1]) / determinant
    return come_m[0] + max(ahead, 0.0) * a


def _joined(ways: Sequence[_Way]) -> tuple[Path, ...]:
    """Paths whose successors start where they end; nobody turns on the spot."""
    starts: dict[Hashable, list[int]] = {}
    for k, way in enumerate(ways):
        starts.setdefault(way.start, []).append(k)
    return tuple(
        Path(
            way.points_m,
            way.half_width_m,
            way.speed_mps,
            tuple(k for k in starts.get(way.end, ()) if ways[k].end != way.start),
            way.rise_m,
        )
        for way in ways
    )
