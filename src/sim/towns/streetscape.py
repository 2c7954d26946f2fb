"""What every town shares: laying streets on the ground, and rows of things along their edges."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..assets import furniture
from ..assets.parts import extent_m
from ..layout import GroundPatch
from ..solid import Solid
from .network import (
    CROSSING_RISE_M,
    JUNCTION_RISE_M,
    PAVEMENT_RISE_M,
    ROAD_RISE_M,
    Profile,
    Street,
)
from .polyline import Polyline, arc_m, heading_at, parallel, point_at
from .site import Site

KERB_M = 0.3
BASE_TILE_M = 32.0
MARGIN_M = 60.0

Maker = Callable[[np.random.Generator], list[Solid]]


@dataclass(frozen=True)
class Spot:
    """A place beside a street; ``yaw_rad`` looks at the street."""

    x_m: float
    y_m: float
    yaw_rad: float

    def moved(self, ahead_m: float, left_m: float, turned_rad: float = 0.0) -> "Spot":
        """Another place, as one who stands here sees it."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        x = self.x_m + cos * ahead_m - sin * left_m
        y = self.y_m + sin * ahead_m + cos * left_m
        return Spot(float(x), float(y), self.yaw_rad + turned_rad)


# -------------------------------------------------------------------------------------- ground


def lay_ground(site: Site, base: str) -> None:
    """The base of the whole town, its streets, pavements, kerbs, junctions and crossings."""
    lower = site.network.junctions_m.min(axis=0) - MARGIN_M
    upper = site.network.junctions_m.max(axis=0) + MARGIN_M
    counts = np.ceil((upper - lower) / BASE_TILE_M).astype(int)
    for i in range(counts[0]):
        for j in range(counts[1]):
            x, y = lower + (np.array([i, j]) + 0.5) * BASE_TILE_M
            site.ground.append(
                GroundPatch((float(x), float(y)), 0.0, BASE_TILE_M, BASE_TILE_M, 0.0, base)
            )
    for street in site.network.streets:
        _lay_street(site, street)
    for junction in range(len(site.network.junctions_m)):
        _lay_junction(site, junction)


def _lay_street(site: Site, street: Street) -> None:
    line, profile = site.network.open_m(street), street.profile
    _lay_strip(site, line, profile.road_m, ROAD_RISE_M, profile.road)
    if not profile.pavement_m:
        return
    for side in (-1, 1):
        kerb = parallel(line, side * (profile.road_m / 2 + KERB_M / 2))
        _lay_strip(site, kerb, KERB_M, PAVEMENT_RISE_M, "kerb")
        width = profile.pavement_m - KERB_M
        pavement = parallel(line, side * (profile.half_m - width / 2))
        _lay_strip(site, pavement, width, PAVEMENT_RISE_M, profile.pavement)


def _lay_junction(site: Site, junction: int) -> None:
    """A plate under every arm, zebra crossings, and pavements around the corners."""
    radius, ports = site.network.radius_m(junction), site.network.ports_m(junction)
    centre = site.network.junctions_m[junction]
    widest_m = max(arm.profile.road_m for arm, _ in ports)
    for arm, _ in ports:
        # A narrower way ends under the road that it meets.
        rise = JUNCTION_RISE_M if arm.profile.road_m == widest_m else ROAD_RISE_M
        plate = "asphalt" if arm.profile.road.startswith("road") else arm.profile.road
        end = point_at(arm.points_m, np.array(radius + 0.2))
        # At a bend between two arms the plate must also fill the outer corner.
        overrun = arm.profile.road_m / 2 if len(ports) == 2 else 0.0
        start = centre - overrun * (end - centre) / np.linalg.norm(end - centre)
        _lay_strip(site, np.stack([start, end]), arm.profile.road_m, rise, plate)
        if arm.profile.has_crossings:
            along = point_at(arm.points_m, radius + np.array([0.2, 3.2]))
            _lay_strip(site, along, arm.profile.road_m, CROSSING_RISE_M, "crossing")
    for (arm, here), (following, there) in zip(ports, ports[1:] + ports[:1]):
        wide = max(arm.profile, following.profile, key=lambda profile: profile.pavement_m)
        if wide.pavement_m:
            corner = site.network.corner_m(arm, following, here[1], there[-1])
            # Around the walking line, as far as the road's edge on the one side.
            width = 2 * (wide.walk_m - wide.road_m / 2)
            _lay_strip(site, corner, width, PAVEMENT_RISE_M, wide.pavement)


def _lay_strip(site: Site, line: Polyline, width_m: float, rise_m: float, material: str) -> None:
    """Rectangles along a line, prolonged at its bends so that their outer edges meet."""
    run_m = arc_m(line)
    for k, (start, end) in enumerate(pairwise(line)):
        yaw = heading_at(line, (run_m[k] + run_m[k + 1]) / 2)
        bends = [
            np.angle(np.exp(1j * (heading_at(line, run_m[j] + side * 1e-3) - yaw)))
            for j, side in ((k, -1), (k + 1, 1))
            if 0 < j < len(line) - 1
        ]
        extra = max((width_m / 2 * abs(np.tan(bend / 2)) for bend in bends), default=0.0)
        length = run_m[k + 1] - run_m[k] + 2 * extra
        x, y = (start + end) / 2
        patch = GroundPatch((float(x), float(y)), yaw, float(length), width_m, rise_m, material)
        site.ground.append(patch)


# ---------------------------------------------------------------------------------------- rows


def spots(
    line: Polyline, left_m: float, spacing_m: float, rng: np.random.Generator, jitter: float = 0.2
) -> Iterator[Spot]:
    """Places ``left_m`` to the left of a line (right where negative), looking back at the line."""
    length = arc_m(line)[-1]
    at = rng.uniform(0.2, 0.8) * min(spacing_m, length)
    while at < length:
        heading = heading_at(line, at)
        x, y = point_at(line, np.array(at)) + left_m * np.array([-np.sin(heading), np.cos(heading)])
        yield Spot(float(x), float(y), heading - np.sign(left_m) * np.pi / 2)
        at += spacing_m * (1 + jitter * rng.uniform(-1, 1))


def stand(site: Site, asset: Sequence[Solid], spot: Spot, rise_m: float = 0.0) -> bool:
    """Place an asset on a spot, if there is room; say whether there was."""
    return site.place(asset, spot.x_m, spot.y_m, spot.yaw_rad, rise_m)


def row(
    site: Site,
    street: Street,
    out_m: float,
    spacing_m: float,
    make: Maker,
    rng: np.random.Generator,
    sides: Sequence[int] = (-1, 1),
) -> None:
    """Things on both sides of a street, ``out_m`` from the edge of its road."""
    profile = street.profile
    rise = PAVEMENT_RISE_M if 0 < out_m < profile.pavement_m else 0.0
    for side in sides:
        left = side * (profile.road_m / 2 + out_m)
        for spot in spots(site.network.open_m(street), left, spacing_m, rng):
            stand(site, make(rng), spot, rise)


def across(
    site: Site, street: Street, spacing_m: float, make: Maker, rng: np.random.Generator
) -> None:
    """Things along x over the whole width of a street, from its middle."""
    for spot in spots(site.network.open_m(street), 1e-3, spacing_m, rng):
        stand(site, make(rng), spot)


def frontage(
    site: Site,
    street: Street,
    make: Maker,
    rng: np.random.Generator,
    setback_m: tuple[float, float],
    gap_m: tuple[float, float],
    sides: Sequence[int] = (-1, 1),
) -> None:
    """Buildings along a street, each behind the pavement by a setback, with gaps between them."""
    line = site.network.open_m(street)
    for side in sides:
        at = rng.uniform(0, 2)
        while at < arc_m(line)[-1]:
            building = make(rng)
            depth, width, _ = extent_m(building)
            middle = min(at + width / 2, arc_m(line)[-1])
            heading = heading_at(line, middle)
            out = street.profile.half_m + rng.uniform(*setback_m) + depth / 2
            normal = side * np.array([-np.sin(heading), np.cos(heading)])
            x, y = point_at(line, np.array(middle)) + out * normal
            fits = site.place(building, float(x), float(y), heading - side * np.pi / 2)
            at += width + rng.uniform(*gap_m) if fits else 3.0


def wired_poles(
    site: Site, street: Street, side: int, rng: np.random.Generator, spacing_m: float = 26.0
) -> None:
    """Utility poles just behind a pavement, with cables from each to the next."""
    height = float(rng.uniform(7.4, 8.0))
    before = None
    left = side * (street.profile.half_m + 0.3)
    for spot in spots(site.network.open_m(street), left, spacing_m, rng, jitter=0.1):
        if not stand(site, furniture.utility_pole(rng, height), spot):
            before = None
            continue
        pole_z = site.height_m(spot.x_m, spot.y_m)
        cos, sin = np.cos(spot.yaw_rad), np.sin(spot.yaw_rad)
        ends = [
            (spot.x_m + cos * x - sin * y, spot.y_m + sin * x + cos * y, pole_z + z)
            for x, y, z in furniture.wire_ends(height)
        ]
        for start, end in zip(before or (), ends):
            site.hang(furniture.wire(start, end, rng.uniform(0.4, 0.8)), pole_z)
        before = ends


def signals(site: Site, rng: np.random.Generator) -> None:
    """Traffic lights on masts at every arm of every junction, before the crossing on the right."""
    for junction in range(len(site.network.junctions_m)):
        radius = site.network.radius_m(junction)
        for arm in site.network.arms(junction):
            if arm.profile.lane_mps is None:
                continue
            heading = heading_at(arm.points_m, radius)
            # Traffic arrives against the arm's direction, so its right side is the arm's left.
            left = arm.profile.road_m / 2 + 0.5
            x, y = point_at(arm.points_m, np.array(radius + 3.8))
            x, y = x - left * np.sin(heading), y + left * np.cos(heading)
            mast = furniture.traffic_light(rng, reach_m=arm.profile.road_m / 2 - 0.2)
            site.place(mast, float(x), float(y), heading - np.pi / 2, PAVEMENT_RISE_M)


def in_gardens(
    site: Site,
    street: Street,
    count: int,
    make: Maker,
    rng: np.random.Generator,
    out_m: tuple[float, float],
    sides: Sequence[int] = (-1, 1),
) -> None:
    """Things scattered beside a street, at random distances from its pavement and directions."""
    line = site.network.open_m(street)
    for _ in range(count):
        side = rng.choice(sides)
        along = rng.uniform(0, arc_m(line)[-1])
        heading = heading_at(line, along)
        left = side * (street.profile.half_m + rng.uniform(*out_m))
        x, y = point_at(line, np.array(along)) + left * np.array(
            [-np.sin(heading), np.cos(heading)]
        )
        site.place(make(rng), float(x), float(y), rng.uniform(0, 2 * np.pi))


def outskirts(
    site: Site,
    count: int,
    make: Maker,
    rng: np.random.Generator,
    south_m: float = -np.inf,
) -> None:
    """Things around the streets, looking inwards, so that no street ends in an empty horizon.

    None stands south of ``south_m``: there may be water.
    """
    lower, upper = site.network.junctions_m.min(axis=0), site.network.junctions_m.max(axis=0)
    middle = (lower + upper) / 2
    reach = (upper - lower) / 2 + MARGIN_M / 2
    for angle in rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, count, endpoint=False):
        ray = np.array([np.cos(angle), np.sin(angle)])
        # On the rim of a rectangle, jittered inwards and outwards.
        x, y = middle + ray / np.abs(ray / reach).max() * rng.uniform(0.9, 1.1)
        yaw = np.round((angle + np.pi) / (np.pi / 2)) * np.pi / 2
        if y > south_m:
            site.place(make(rng), float(x), float(y), float(yaw))


TWO_LANES = Profile(7.0, "road_2lane", 3.4, "paving", 9.0, 2.4, 7.0)
FOUR_LANES = Profile(14.0, "road_4lane", 4.5, "paving", 11.0, 4.0, 8.0)
