"""The ground of a town: its base, and the roads, kerbs, pavements and junctions laid upon it."""

import numpy as np

from .network import CROSSING_RISE_M, JUNCTION_RISE_M, PAVEMENT_RISE_M, ROAD_RISE_M, Street
from .polyline import Polyline, arc_m, parallel, point_at
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
    for tile in np.ndindex(*counts):
        x, y = lower + (np.array(tile) + 0.5) * BASE_TILE_M
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
    for arm, following, corner_m in site.network.corners(junction):
        wide = max(arm.profile, following.profile, key=lambda profile: profile.pavement_m)
        if wide.pavement_m:
            # Around the walking line, as far as the road's edge on the one side.
            width_m = 2 * (wide.walk_m - wide.road_m / 2)
            _lay_strip(site, corner_m, width_m, PAVEMENT_RISE_M, wide.pavement)


def _lay_strip(site: Site, line: Polyline, width_m: float, rise_m: float, material: str) -> None:
    """Lays rectangles along a line, prolonged at its bends so that their outer edges meet."""
    x_m, y_m = np.diff(line, axis=0).T
    yaw_rad, length_m = np.arctan2(y_m, x_m), np.diff(arc_m(line))
    bend_rad = np.angle(np.exp(1j * np.diff(yaw_rad)))
    # The line does not bend at its two ends.
    extra_m = np.pad(width_m / 2 * np.abs(np.tan(bend_rad / 2)), 1)

    for k, middle_m in enumerate((line[:-1] + line[1:]) / 2):
        size_m = (length_m[k] + 2 * extra_m[k : k + 2].max(), width_m)
        site.lay(*middle_m, yaw_rad[k], size_m, rise_m, material)
