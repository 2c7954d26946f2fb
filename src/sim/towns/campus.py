"""Campus: a wide plaza where six paved walks meet, lawns between them, and a ring of streets with
teaching blocks on columns; arcades, flags, and banners on cables."""

from functools import partial
from itertools import pairwise

import numpy as np

from ..assets import furniture, plaza, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import ROAD_RISE_M, Network, Profile, Street, straight
from .parking import park
from .polyline import Spot
from .streetscape import TWO_LANES, Streetscape

_WALK = Profile(6.0, "paving_warm", 0.0, "paving_warm", None, 2.6, 6.5)
_FACADES = ("facade_glass", "facade_panel", "facade_concrete", "facade_brick")
_SIDES = 6
# From the plaza's middle to its edge.
_PLAZA_M = 27.0


def _network(rng: Rng) -> Network:
    """A long hexagon of streets, and six walks from its corners to the plaza in the middle."""
    angle = np.arange(_SIDES) * 2 * np.pi / _SIDES
    rim = np.stack([112.0 * np.cos(angle), 80.0 * np.sin(angle)], axis=1)
    rim += rng.uniform(-4, 4, (_SIDES, 2))
    yaw = rng.uniform(0, 2 * np.pi)
    cos, sin = np.cos(yaw), np.sin(yaw)
    rim = rim @ np.array([[cos, sin], [-sin, cos]])

    junctions = np.concatenate([rim, rng.uniform(-3, 3, (1, 2))])
    ring = straight(junctions, [(k, (k + 1) % _SIDES) for k in range(_SIDES)], TWO_LANES)
    spokes = straight(junctions, [(k, _SIDES) for k in range(_SIDES)], _WALK)
    return Network(junctions, ring + spokes)


def _block(rng: Rng) -> list[Solid]:
    facade, storeys = rng.choice(_FACADES), int(rng.integers(2, 6))
    if rng.random() < 0.25:
        return plaza.linked_slabs(rng, int(rng.integers(4, 6)), storeys, facade)
    return plaza.slab(rng, int(rng.integers(5, 10)), storeys, facade)


# ------------------------------------------------------------------------- between two walks


def _lawn(site: Streetscape, street: Street) -> None:
    """Strips of grass, parallel to a street, that fill the wedge between it and the plaza."""
    middle = site.network.junctions_m[_SIDES]
    left, right = street.points_m[-1] - middle, street.points_m[0] - middle
    along = left - right
    along /= float(np.linalg.norm(along))
    out = np.array([along[1], -along[0]])
    yaw = float(np.arctan2(along[1], along[0]))
    height_m = float(abs(right[0] * along[1] - right[1] * along[0]))

    # How far a lawn's corners stay from the walks' middle lines, measured along the street.
    slopes = [abs(v @ along) / height_m for v in (right, left)]
    margins = [(_WALK.road_m / 2 + 1.6) * np.hypot(1, slope) for slope in slopes]
    edges_m = np.linspace(_PLAZA_M, height_m - street.profile.half_m - 1.0, 8)
    for low_m, high_m in pairwise(edges_m):
        start, end = (middle + low_m / height_m * v for v in (right, left))
        start, end = start + margins[0] * along, end - margins[1] * along
        length_m = float((end - start) @ along)
        if length_m >= 3:
            place_m = (start + end) / 2 + out * (high_m - low_m) / 2
            site.lay(*place_m, yaw, (length_m, high_m - low_m), ROAD_RISE_M, "grass")


def _plaza_sector(site: Streetscape, street: Street) -> None:
    """The plaza between two walks: a fountain or a sculpture, benches, trees in tubs, flags."""
    rng = site.rng
    middle = site.network.junctions_m[_SIDES]
    directions = [(p - middle) / np.linalg.norm(p - middle) for p in street.points_m[[0, -1]]]
    bearing = float(np.arctan2(*(directions[0] + directions[1])[::-1]))
    center = Spot(*middle.tolist(), bearing)
    centerpiece = plaza.fountain if rng.random() < 0.4 else plaza.sculpture
    site.place(centerpiece(rng), *center.moved(12.0, 0.0, np.pi))

    # How far out, how far to the left, and what stands there; all look at the middle.
    rows = [(17.5 - abs(left_m) / 3, left_m, plaza.tree_planter) for left_m in (-5.0, 0.0, 5.0)]
    rows += [(18.5, left_m, furniture.bench) for left_m in (-2.5, 2.5)]
    rows += [(22.0, left_m, plaza.flag_pole) for left_m in (-7.5, -4.5, -1.5, 1.5, 4.5, 7.5)]
    for out_m, left_m, make in rows:
        site.place(make(rng), *center.moved(out_m, left_m, np.pi))
    for left_m in (-8.0, 8.0):
        site.place(furniture.park_lamp(rng), *center.moved(19.0, left_m))


# ---------------------------------------------------------------------------- along the ways


def _furnish_street(site: Streetscape, street: Street) -> None:
    edge = street.profile.pavement_m
    site.row(street, 0.55, 26.0, furniture.lamp_post)
    site.row(street, 0.5, 38.0, furniture.sign_post)
    site.row(street, 0.9, 13.0, vegetation.street_tree)
    site.row(street, 0.6, 30.0, partial(furniture.railing, length_m=6.0))
    park(site, street, 0.15)
    site.row(street, edge + 0.6, 14.0, plaza.bollards)
    site.row(street, edge + 1.0, 16.0, plaza.bike_rack)
    site.row(street, edge + 1.2, 11.0, plaza.planter)
    # The streets run counter-clockwise, so their right sides look away from the plaza.
    site.in_gardens(street, 12, vegetation.broadleaf, (3.0, 40.0), (-1,))


def _furnish_walk(site: Streetscape, walk: Street) -> None:
    site.row(walk, 0.8, 15.0, furniture.park_lamp)
    site.row(walk, 0.8, 12.0, furniture.bench)
    site.row(walk, 1.0, 15.0, plaza.flag_pole)
    site.row(walk, 1.1, 17.0, plaza.bike_rack)
    site.row(walk, 0.8, 24.0, furniture.litter_bin)
    site.row(walk, 1.2, 12.0, plaza.planter)
    site.row(walk, 3.5, 30.0, plaza.sculpture)
    site.in_gardens(walk, 12, vegetation.broadleaf, (4.0, 24.0))
    site.in_gardens(walk, 4, vegetation.bare_tree, (3.0, 20.0))
    site.in_gardens(walk, 6, vegetation.bush, (2.5, 20.0))


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("campus", _network(rng), rng, relief_m=0.4)
    site.lay_ground("paving")
    streets, walks = site.network.streets[:_SIDES], site.network.streets[_SIDES:]
    for street in streets:
        _lawn(site, street)
        _plaza_sector(site, street)
    for walk in walks:
        site.across(walk, 20.0, partial(plaza.banner_line, width_m=_WALK.road_m + 1.6))
        site.row(walk, 2.9, 26.0, partial(plaza.arcade, length_m=16.0), (1,))

    for street in streets:
        site.frontage(street, _block, setback_m=(2.0, 5.0), gap_m=(5.0, 14.0))
    for street in streets:
        _furnish_street(site, street)
    for walk in walks:
        _furnish_walk(site, walk)
    site.outskirts(20, _block)
    site.outskirts(36, vegetation.broadleaf)
    return site.finished()
