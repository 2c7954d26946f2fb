"""Campus: a wide plaza where six paved walks meet, lawns between them, and a ring of streets with
teaching blocks on columns; arcades, flags, and banners on cables."""

from functools import partial
from itertools import pairwise

import numpy as np

from ..assets import furniture, plaza, vegetation
from ..layout import GroundPatch, Town
from ..solid import Solid
from .network import ROAD_RISE_M, Network, Profile, Street
from .parking import park
from .site import Site
from .streetscape import (
    TWO_LANES,
    Spot,
    across,
    frontage,
    in_gardens,
    lay_ground,
    outskirts,
    row,
    stand,
)
from .terrain import rolling

_WALK = Profile(6.0, "paving_warm", 0.0, "paving_warm", None, 2.6, 6.5)
_FACADES = ("facade_glass", "facade_panel", "facade_concrete", "facade_brick")
_SIDES = 6
_STREETS, _WALKS = slice(0, _SIDES), slice(_SIDES, 2 * _SIDES)
_OUTSIDE, _INSIDE = (-1,), (1,)
"""Sides of the streets, which run counter-clockwise."""

_PLAZA_M = 27.0
"""From its middle to its edge."""


def _network(rng: np.random.Generator) -> Network:
    """A long hexagon of streets, and six walks from its corners to the plaza in the middle."""
    angle = np.arange(_SIDES) * 2 * np.pi / _SIDES
    rim = np.stack([112.0 * np.cos(angle), 80.0 * np.sin(angle)], axis=1)
    rim += rng.uniform(-4, 4, (_SIDES, 2))
    yaw = rng.uniform(0, 2 * np.pi)
    cos, sin = np.cos(yaw), np.sin(yaw)
    rim = rim @ np.array([[cos, sin], [-sin, cos]])
    junctions = np.concatenate([rim, rng.uniform(-3, 3, (1, 2))])
    ring = [(k, (k + 1) % _SIDES, TWO_LANES) for k in range(_SIDES)]
    spokes = [(k, _SIDES, _WALK) for k in range(_SIDES)]
    streets = (Street(a, b, junctions[[a, b]], profile) for a, b, profile in ring + spokes)
    return Network(junctions, tuple(streets))


def _block(rng: np.random.Generator) -> list[Solid]:
    facade, storeys = str(rng.choice(_FACADES)), int(rng.integers(2, 6))
    if rng.random() < 0.25:
        return plaza.linked_slabs(rng, int(rng.integers(4, 6)), storeys, facade)
    return plaza.slab(rng, int(rng.integers(5, 10)), storeys, facade)


# ------------------------------------------------------------------------- between two walks


def _lawn(site: Site, street: Street) -> None:
    """Strips of grass, parallel to a street, that fill the wedge between it and the plaza."""
    middle = site.network.junctions_m[_SIDES]
    left, right = street.points_m[-1] - middle, street.points_m[0] - middle
    along = left - right
    side_m = float(np.linalg.norm(along))
    along /= side_m
    height_m = float(abs(right[0] * along[1] - right[1] * along[0]))
    # How far a lawn's corners stay from the walks' middle lines, measured along the street.
    bases = [abs(v @ along) / height_m for v in (right, left)]
    margins = [(_WALK.road_m / 2 + 1.6) * np.hypot(1, slope) for slope in bases]
    edges_m = np.linspace(_PLAZA_M, height_m - street.profile.half_m - 1.0, 8)
    for low_m, high_m in pairwise(edges_m):
        start, end = (middle + low_m / height_m * v for v in (right, left))
        start, end = start + margins[0] * along, end - margins[1] * along
        length_m = float((end - start) @ along)
        if length_m < 3:
            continue
        out = np.array([along[1], -along[0]])
        x, y = (start + end) / 2 + out * (high_m - low_m) / 2
        yaw = float(np.arctan2(along[1], along[0]))
        size_m = (length_m, float(high_m - low_m))
        site.ground.append(GroundPatch((float(x), float(y)), yaw, *size_m, ROAD_RISE_M, "grass"))


def _plaza_sector(site: Site, street: Street, rng: np.random.Generator) -> None:
    """The plaza between two walks: a fountain or a sculpture, benches, trees in tubs, flags."""
    middle = site.network.junctions_m[_SIDES]
    directions = [(p - middle) / np.linalg.norm(p - middle) for p in street.points_m[[0, -1]]]
    bearing = float(np.arctan2(*(directions[0] + directions[1])[::-1]))
    here = Spot(*middle.tolist(), bearing)
    centrepiece = plaza.fountain if rng.random() < 0.4 else plaza.sculpture
    stand(site, centrepiece(rng), here.moved(12.0, 0.0, np.pi))
    for left_m in (-5.0, 0.0, 5.0):
        stand(site, plaza.tree_planter(rng), here.moved(17.5 - abs(left_m) / 3, left_m, np.pi))
    for left_m in (-2.5, 2.5):
        stand(site, furniture.bench(rng), here.moved(18.5, left_m, np.pi))
    for left_m in (-7.5, -4.5, -1.5, 1.5, 4.5, 7.5):
        stand(site, plaza.flag_pole(rng), here.moved(22.0, left_m, np.pi))
    for left_m in (-8.0, 8.0):
        stand(site, furniture.park_lamp(rng), here.moved(19.0, left_m))


# ---------------------------------------------------------------------------- along the ways


def _furnish_street(site: Site, street: Street, rng: np.random.Generator) -> None:
    row(site, street, 0.55, 26.0, furniture.lamp_post, rng)
    row(site, street, 0.5, 38.0, furniture.sign_post, rng)
    row(site, street, 0.9, 13.0, vegetation.street_tree, rng)
    row(site, street, 0.6, 30.0, partial(furniture.railing, length_m=6.0), rng)
    park(site, street, rng, 0.15)
    edge = street.profile.pavement_m
    row(site, street, edge + 0.6, 14.0, plaza.bollards, rng)
    row(site, street, edge + 1.0, 16.0, plaza.bike_rack, rng)
    row(site, street, edge + 1.2, 11.0, plaza.planter, rng)
    in_gardens(site, street, 12, vegetation.broadleaf, rng, (3.0, 40.0), _OUTSIDE)


def _furnish_walk(site: Site, walk: Street, rng: np.random.Generator) -> None:
    row(site, walk, 0.8, 15.0, furniture.park_lamp, rng)
    row(site, walk, 0.8, 12.0, furniture.bench, rng)
    row(site, walk, 1.0, 15.0, plaza.flag_pole, rng)
    row(site, walk, 1.1, 17.0, plaza.bike_rack, rng)
    row(site, walk, 0.8, 24.0, furniture.litter_bin, rng)
    row(site, walk, 1.2, 12.0, plaza.planter, rng)
    row(site, walk, 3.5, 30.0, plaza.sculpture, rng)
    in_gardens(site, walk, 12, vegetation.broadleaf, rng, (4.0, 24.0))
    in_gardens(site, walk, 4, vegetation.bare_tree, rng, (3.0, 20.0))
    in_gardens(site, walk, 6, vegetation.bush, rng, (2.5, 20.0))


def build(rng: np.random.Generator) -> Town:
    site = Site("campus", _network(rng), rolling(rng, 0.4))
    lay_ground(site, "paving")
    streets, walks = site.network.streets[_STREETS], site.network.streets[_WALKS]
    for street in streets:
        _lawn(site, street)
        _plaza_sector(site, street, rng)
    for walk in walks:
        across(site, walk, 20.0, partial(plaza.banner_line, width_m=_WALK.road_m + 1.6), rng)
        row(site, walk, 2.9, 26.0, partial(plaza.arcade, length_m=16.0), rng, (1,))
    for street in streets:
        frontage(site, street, _block, rng, setback_m=(2.0, 5.0), gap_m=(5.0, 14.0))
    for street in streets:
        _furnish_street(site, street, rng)
    for walk in walks:
        _furnish_walk(site, walk, rng)
    outskirts(site, 20, _block, rng)
    outskirts(site, 36, vegetation.broadleaf, rng)
    return site.finished()
