"""The ground of a town: its base, and the roads, kerbs, pavements and junctions laid upon it."""

from itertools import pairwise

import numpy as np

from .network import CROSSING_RISE_M, JUNCTION_RISE_M, PAVEMENT_RISE_M, ROAD_RISE_M, Street
from .polyline import Polyline, arc_m, heading_at, parallel, point_at
from .site import Site

KERB_M = 0.3
# The base is laid in square tiles, and reaches beyond the outermost junctions.
BASE_TILE_M = 32.0
MARGIN_M = 60.0


def lay_base(site: Site, material: str) -> None:
    """Lays the base of the whole town."""
    lower = site.network.junctions_m.min(axis=0) - MARGIN_M
    upper = site.network.junctions_m.max(axis=0) + MARGIN_M
    counts = np.ceil((upper - lower) / BASE_TILE_M).astype(int)
    for i in range(counts[0]):
        for j in range(counts[1]):
            x, y = lower + (np.array([i, j]) + 0.5) * BASE_TILE_M
            site.lay(x, y, 0.0, (BASE_TILE_M, BASE_TILE_M), 0.0, material)


def lay_street(site: Site, street: Street) -> None:
    """Lays a street's road, its kerbs and its pavements."""
    line, profile = site.network.open_m(street), street.profile
    _lay_strip(site, line, profile.road_m, ROAD_RISE_M, profile.road)
    if not profile.pavement_m:
        return

    width = profile.pavement_m - KERB_M
    for side in (-1, 1):
        kerb = parallel(line, side * (profile.road_m / 2 + KERB_M / 2))
        _lay_strip(site, kerb, KERB_M, PAVEMENT_RISE_M, "kerb")
        pavement = parallel(line, side * (profile.half_m - width / 2))
        _lay_strip(site, pavement, width, PAVEMENT_RISE_M, profile.pavement)


def lay_junction(site: Site, junction: int) -> None:
    """Lays a plate under every arm, zebra crossings, and pavements around the corners."""
    radius, arms = site.network.radius_m(junction), site.network.arms(junction)
    center = site.network.junctions_m[junction]
    widest_m = max(arm.profile.road_m for arm in arms)

    for arm in arms:
        profile = arm.profile
        # A narrower way ends under the road that it meets.
        rise = JUNCTION_RISE_M if profile.road_m == widest_m else ROAD_RISE_M
        plate = "asphalt" if profile.has_crossings else profile.road
        end = point_at(arm.points_m, np.array(radius + 0.2))
        # At a bend between two arms the plate must also fill the outer corner.
        overrun = profile.road_m / 2 if len(arms) == 2 else 0.0
        start = center - overrun * (end - center) / np.linalg.norm(end - center)
        _lay_strip(site, np.stack([start, end]), profile.road_m, rise, plate)
        if profile.has_crossings:
            along = point_at(arm.points_m, radius + np.array([0.2, 3.2]))
            _lay_strip(site, along, profile.road_m, CROSSING_RISE_M, "crossing")
    _lay_corners(site, junction)


def _lay_corners(site: Site, junction: int) -> None:
    """Lays the pavement around each corner, as wide as the wider of the two that meet there."""
    ports = site.network.ports_m(junction)
    for (arm, sides_m), (following, next_sides_m) in zip(ports, ports[1:] + ports[:1]):
        wide = max(arm.profile, following.profile, key=lambda profile: profile.pavement_m)
        if wide.pavement_m:
            corner = site.network.corner_m(arm, following, sides_m[1], next_sides_m[-1])
            # Around the walking line, as far as the road's edge on the one side.
            width = 2 * (wide.walk_m - wide.road_m / 2)
            _lay_strip(site, corner, width, PAVEMENT_RISE_M, wide.pavement)


def _lay_strip(site: Site, line: Polyline, width_m: float, rise_m: float, material: str) -> None:
    """Lays rectangles along a line, prolonged at its bends so that their outer edges meet."""
    run_m = arc_m(line)
    for k, (start, end) in enumerate(pairwise(line)):
        yaw = heading_at(line, (run_m[k] + run_m[k + 1]) / 2)
        # How far the line turns where this piece meets its neighbours.
        bends = [
            np.angle(np.exp(1j * (heading_at(line, run_m[j] + side * 1e-3) - yaw)))
            for j, side in ((k, -1), (k + 1, 1))
            if 0 < j < len(line) - 1
        ]
        extra = max((width_m / 2 * abs(np.tan(bend / 2)) for bend in bends), default=0.0)
        length = run_m[k + 1] - run_m[k] + 2 * extra
        site.lay(*(start + end) / 2, yaw, (length, width_m), rise_m, material)
