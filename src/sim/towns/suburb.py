"""Suburb: curved streets, detached houses in gardens, fences, hedges, and wires on timber poles."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import drives
from .polyline import turn
from .site import Site
from .streetscape import frontage, in_gardens, lay_ground, outskirts, row, wired_poles
from .terrain import rolling

_STREET = Profile(7.0, "road_2lane", 2.2, "paving_warm", 8.0, 2.6, 6.5)
_FACADES = ("siding_white", "siding_blue", "facade_plaster_cream", "facade_brick")


def _network(rng: np.random.Generator) -> Network:
    """Two curved avenues, joined by three cross streets."""
    xs, ys = np.array([-130.0, 0.0, 130.0]), np.array([-50.0, 50.0])
    junctions = np.array([(x, y) for y in ys for x in xs]) + rng.uniform(-6, 6, (6, 2))
    pairs = [(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5)]
    streets = []
    for start, end in pairs:
        a, b = junctions[start], junctions[end]
        across = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        bow = rng.choice([-1, 1]) * rng.uniform(10, 22)
        streets.append(Street(start, end, turn(a, (a + b) / 2 + bow * across, b, 9), _STREET))
    return Network(junctions, tuple(streets))


def _house(rng: np.random.Generator) -> list[Solid]:
    facade = str(rng.choice(_FACADES))
    bays, storeys = int(rng.integers(3, 5)), int(rng.integers(1, 3))
    return buildings.gabled_house(rng, bays, float(rng.uniform(8, 10)), storeys, facade)


def build(rng: np.random.Generator) -> Town:
    site = Site("suburb", _network(rng), rolling(rng, 0.45))
    lay_ground(site, "grass")
    edge = _STREET.pavement_m
    for k, street in enumerate(site.network.streets):
        wired_poles(site, street, side=1 if k % 2 else -1, rng=rng)
        frontage(site, street, _house, rng, setback_m=(5.0, 8.0), gap_m=(4.0, 9.0))
        drives(site, street, rng, 17.0)
        row(site, street, edge + 0.9, 7.0, partial(furniture.fence, length_m=6.0), rng)
        row(site, street, edge + 1.1, 9.0, partial(vegetation.hedge, length_m=5.0), rng)
        row(site, street, 0.4, 36.0, furniture.lamp_post, rng)
        row(site, street, 0.4, 44.0, furniture.sign_post, rng)
        row(site, street, edge - 0.35, 28.0, furniture.litter_bin, rng)
        row(site, street, edge + 3.2, 13.0, vegetation.broadleaf, rng)
        in_gardens(site, street, 16, vegetation.broadleaf, rng, (3.5, 26.0))
        in_gardens(site, street, 4, vegetation.conifer, rng, (3.0, 26.0))
        in_gardens(site, street, 2, vegetation.bare_tree, rng, (2.5, 14.0))
        in_gardens(site, street, 8, vegetation.bush, rng, (1.5, 20.0))
        in_gardens(site, street, 2, buildings.shed, rng, (12.0, 26.0))
        in_gardens(site, street, 1, furniture.bench, rng, (2.0, 12.0))
    outskirts(site, 22, _house, rng)
    outskirts(site, 44, vegetation.broadleaf, rng)
    return site.finished()
