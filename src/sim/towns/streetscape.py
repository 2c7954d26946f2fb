"""A site with all that lines its streets: rows of things, building fronts, wires, lights, gardens.

Every maker of an asset, ``make(rng)``, is called with the town's own generator.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..assets import furniture
from ..assets.parts import extent_m
from ..layout import HeightField
from ..solid import Rng, Solid
from .ground import MARGIN_M, lay_base, lay_junction, lay_street
from .network import PAVEMENT_RISE_M, STOP_LINE_OUT_M, Network, Profile, Street
from .polyline import Polyline, Spot, arc_m, beside
from .site import Site

Maker = Callable[[Rng], Sequence[Solid]]
Sides = Sequence[int]
Span = tuple[float, float]

# Left of a street is 1, right is -1.
BOTH = (-1, 1)

TWO_LANES = Profile(7.0, "road_2lane", 3.4, "paving", 9.0, 2.4, 7.0)
FOUR_LANES = Profile(14.0, "road_4lane", 4.5, "paving", 11.0, 4.0, 8.0)


class Streetscape(Site):
    """A site that furnishes its streets; ``rng`` decides where, and is passed on to the makers.

    The ground rolls by ``relief_m`` above and below zero.
    """

    def __init__(self, name: str, network: Network, rng: Rng, relief_m: float = 0.35):
        super().__init__(name, network, _rolling(rng, relief_m))
        self.rng = rng

    def lay_ground(self, base: str) -> None:
        """Lays the base of the whole town, its streets, pavements, kerbs, junctions, crossings."""
        lay_base(self, base)
        for street in self.network.streets:
            lay_street(self, street)
        for junction in range(len(self.network.junctions_m)):
            lay_junction(self, junction)

    def spots(
        self, line: Polyline, left_m: float, spacing_m: float, jitter: float = 0.2
    ) -> Iterator[Spot]:
        """Yields places to the left of a line (right where negative), looking back at the line."""
        length = arc_m(line)[-1]
        at = self.rng.uniform(0.2, 0.8) * min(spacing_m, length)
        while at < length:
            yield beside(line, at, left_m).moved(0.0, 0.0, -np.sign(left_m) * np.pi / 2)
            at += spacing_m * (1 + jitter * self.rng.uniform(-1, 1))

    def row(
        self, street: Street, out_m: float, spacing_m: float, make: Maker, sides: Sides = BOTH
    ) -> None:
        """Places things along a street, ``out_m`` from the edge of its road."""
        profile = street.profile
        rise = PAVEMENT_RISE_M if 0 < out_m < profile.pavement_m else 0.0
        for side in sides:
            left = side * (profile.road_m / 2 + out_m)
            for spot in self.spots(self.network.open_m(street), left, spacing_m):
                self.place(make(self.rng), *spot, rise)

    def across(
        self, street: Street, spacing_m: float, make: Maker, shortest_m: float = 0.0
    ) -> None:
        """Places things along x over the whole width of a street, where it is long enough."""
        line = self.network.open_m(street)
        if arc_m(line)[-1] > shortest_m:
            # A millimetre to the left, so that there is a side to look back from.
            for spot in self.spots(line, 1e-3, spacing_m):
                self.place(make(self.rng), *spot)

    def frontage(
        self, street: Street, make: Maker, setback_m: Span, gap_m: Span, sides: Sides = BOTH
    ) -> None:
        """Places buildings along a street, each behind the pavement by a setback, with gaps."""
        line = self.network.open_m(street)
        for side in sides:
            at = self.rng.uniform(0, 2)
            while at < arc_m(line)[-1]:
                building = make(self.rng)
                depth, width, _ = extent_m(building)

                # Its middle never lies beyond the street's end.
                middle = min(at + width / 2, arc_m(line)[-1])
                out = street.profile.half_m + self.rng.uniform(*setback_m) + depth / 2
                front = beside(line, middle, side * out).moved(0.0, 0.0, -side * np.pi / 2)
                # Where one is refused, a little further along another may fit.
                fits = self.place(building, *front)
                at += width + self.rng.uniform(*gap_m) if fits else 3.0

    def wired_poles(self, street: Street, side: int) -> None:
        """Places utility poles just behind a pavement, with cables from each to the next."""
        height = float(self.rng.uniform(7.4, 8.0))
        left = side * (street.profile.half_m + 0.3)
        before: list[tuple[float, float, float]] = []
        for spot in self.spots(self.network.open_m(street), left, 26.0, jitter=0.1):
            if not self.place(furniture.utility_pole(self.rng, height), *spot):
                before = []
                continue

            pole_z = self.height_m(spot.x_m, spot.y_m)
            ends = [(*spot.moved(x, y)[:2], pole_z + z) for x, y, z in furniture.wire_ends(height)]
            for start, end in zip(before, ends):
                self.hang(furniture.wire(start, end, self.rng.uniform(0.4, 0.8)), pole_z)
            before = ends

    def traffic_lights(self) -> None:
        """Places masts at every arm of every junction, before the crossing on the right."""
        for junction in range(len(self.network.junctions_m)):
            radius = self.network.radius_m(junction)
            for arm in self.network.arms(junction):
                if arm.profile.lane_mps is None:
                    continue

                # Traffic arrives against the arm's direction, so its right side is the arm's left.
                half_m = arm.profile.road_m / 2
                kerb = beside(arm.points_m, radius + STOP_LINE_OUT_M, half_m + 0.5)
                mast = furniture.traffic_light(self.rng, reach_m=half_m - 0.2)
                self.place(mast, *kerb.moved(0.0, 0.0, -np.pi / 2), PAVEMENT_RISE_M)

    def in_gardens(
        self, street: Street, count: int, make: Maker, out_m: Span, sides: Sides = BOTH
    ) -> None:
        """Scatters things beside a street, at random distances from its pavement, turned anyhow."""
        line = self.network.open_m(street)
        for _ in range(count):
            side = self.rng.choice(sides)
            along = self.rng.uniform(0, arc_m(line)[-1])
            left = side * (street.profile.half_m + self.rng.uniform(*out_m))
            x, y, _ = beside(line, along, left)
            self.place(make(self.rng), x, y, self.rng.uniform(0, 2 * np.pi))

    def outskirts(self, count: int, make: Maker, south_m: float = -np.inf) -> None:
        """Places things around the streets, looking inwards: no street ends in an empty horizon.

        None stands south of ``south_m``: there may be water.
        """
        junctions_m = self.network.junctions_m
        lower, upper = junctions_m.min(axis=0), junctions_m.max(axis=0)
        middle = (lower + upper) / 2
        reach = (upper - lower) / 2 + MARGIN_M / 2

        first_rad = self.rng.uniform(0, 2 * np.pi)
        for angle in first_rad + np.linspace(0, 2 * np.pi, count, endpoint=False):
            ray = np.array([np.cos(angle), np.sin(angle)])
            # On the rim of a rectangle, jittered inwards and outwards.
            x, y = middle + ray / np.abs(ray / reach).max() * self.rng.uniform(0.9, 1.1)
            yaw = np.round((angle + np.pi) / (np.pi / 2)) * np.pi / 2
            if y > south_m:
                self.place(make(self.rng), float(x), float(y), float(yaw))


def _rolling(rng: Rng, height_m: float) -> HeightField:
    """Three waves of 60 to 150 m in random directions, within ``height_m`` above and below zero."""
    # Low, long waves: no road is exactly flat, and none is steep.
    heading = rng.uniform(0, 2 * np.pi, 3)
    number = 2 * np.pi / rng.uniform(60, 150, 3)
    phase = rng.uniform(0, 2 * np.pi, 3)
    share = rng.uniform(0.5, 1.0, 3)
    amplitude_m = height_m * share / share.sum()

    def terrain(x_m, y_m):
        along = np.multiply.outer(x_m, np.cos(heading)) + np.multiply.outer(y_m, np.sin(heading))
        return (amplitude_m * np.sin(number * along + phase)).sum(axis=-1)

    return terrain
