"""Campus: paved walks from a ring of streets to a plaza, teaching blocks on columns, arcades,
flag poles and banners on cables."""

from functools import partial

import numpy as np

from ..assets import furniture, plaza, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import lot, park
from .polyline import arc_m
from .site import Site
from .streetscape import TWO_LANES, frontage, in_gardens, lay_ground, outskirts, row, spots
from .terrain import rolling

_WALK = Profile(6.0, "paving", 0.0, "paving", None, 2.6, 6.5)
_FACADES = ("facade_glass", "facade_panel", "facade_concrete", "facade_brick")
_SIDES = 6


def _network(rng: np.random.Generator) -> Network:
    """A hexagon of streets, and six walks from its corners to the plaza in the middle."""
    angle = np.linspace(0, 2 * np.pi, _SIDES + 1)[:-1] + rng.uniform(0.2, 0.4)
    rim = 92.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + rng.uniform(-5, 5, (_SIDES, 2))
    junctions = np.concatenate([rim, rng.uniform(-4, 4, (1, 2))])
    streets = []
    for k in range(_SIDES):
        after = (k + 1) % _SIDES
        streets.append(Street(k, after, junctions[[k, after]], TWO_LANES))
        streets.append(Street(k, _SIDES, junctions[[k, _SIDES]], _WALK))
    return Network(junctions, tuple(streets))


def _block(rng: np.random.Generator) -> list[Solid]:
    facade = str(rng.choice(_FACADES))
    return plaza.slab(rng, int(rng.integers(5, 10)), int(rng.integers(2, 6)), facade)


def _furnish_street(site: Site, street: Street, rng: np.random.Generator) -> None:
    row(site, street, 0.55, 26.0, furniture.lamp_post, rng)
    row(site, street, 0.5, 38.0, furniture.sign_post, rng)
    row(site, street, 0.9, 13.0, vegetation.street_tree, rng)
    row(site, street, 0.6, 30.0, partial(furniture.railing, length_m=6.0), rng)
    park(site, street, rng, 0.6)
    row(site, street, street.profile.pavement_m + 1.2, 11.0, plaza.planter, rng)


def _furnish_walk(site: Site, walk: Street, rng: np.random.Generator) -> None:
    row(site, walk, 1.0, 15.0, furniture.park_lamp, rng)
    row(site, walk, 1.2, 12.0, furniture.bench, rng)
    row(site, walk, 1.4, 17.0, plaza.flag_pole, rng)
    row(site, walk, 1.4, 14.0, plaza.bike_rack, rng)
    row(site, walk, 1.1, 24.0, furniture.litter_bin, rng)
    row(site, walk, 1.6, 10.0, plaza.planter, rng)
    row(site, walk, 3.0, 26.0, plaza.sculpture, rng)
    in_gardens(site, walk, 10, vegetation.broadleaf, rng, (2.5, 24.0))
    in_gardens(site, walk, 3, vegetation.bare_tree, rng, (2.5, 20.0))
    in_gardens(site, walk, 6, vegetation.bush, rng, (1.5, 20.0))


def _banners(site: Site, walk: Street, rng: np.random.Generator) -> None:
    line = site.network.open_m(walk)
    make = partial(plaza.banner_line, width_m=walk.profile.road_m + 1.6)
    if arc_m(line)[-1] > 20:
        for spot in spots(line, 1e-3, 22.0, rng):
            site.place(make(rng), spot.x_m, spot.y_m, spot.yaw_rad)


def build(rng: np.random.Generator) -> Town:
    site = Site("campus", _network(rng), rolling(rng, 0.4))
    lay_ground(site, "grass")
    ring = [street for street in site.network.streets if street.profile is not _WALK]
    walks = [street for street in site.network.streets if street.profile is _WALK]
    for walk in walks:
        _banners(site, walk, rng)
        row(site, walk, 2.6, 30.0, partial(plaza.arcade, length_m=16.0), rng, (1,))
    for street in ring:
        frontage(site, street, _block, rng, setback_m=(2.0, 5.0), gap_m=(5.0, 14.0))
    for street in ring:
        _furnish_street(site, street, rng)
    for walk in walks:
        _furnish_walk(site, walk, rng)
    for angle in np.arange(3) * 2 * np.pi / 3 + rng.uniform(0, 2):
        middle = (float(130 * np.cos(angle)), float(130 * np.sin(angle)))
        lot(site, middle, float(angle), rng, columns=8, share=0.6)
    outskirts(site, 20, _block, rng)
    outskirts(site, 36, vegetation.broadleaf, rng)
    return site.finished()
