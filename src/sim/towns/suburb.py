"""Suburb: curved streets, detached houses in gardens, fences, hedges, and wires on timber poles."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import Network, Profile, bowed
from .parking import drives
from .streetscape import Streetscape

_STREET = Profile(7.0, "road_2lane", 2.2, "paving_warm", 8.0, 2.6, 6.5)
_FACADES = ("siding_white", "siding_blue", "facade_plaster_cream", "facade_brick")


def _network(rng: Rng) -> Network:
    """Two curved avenues, joined by three cross streets."""
    xs, ys = np.array([-130.0, 0.0, 130.0]), np.array([-50.0, 50.0])
    junctions = np.array([(x, y) for y in ys for x in xs]) + rng.uniform(-6, 6, (6, 2))
    pairs = [(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5)]
    return Network(junctions, bowed(rng, junctions, pairs, _STREET, (10, 22)))


def _house(rng: Rng) -> list[Solid]:
    facade = rng.choice(_FACADES)
    bays, storeys = int(rng.integers(3, 5)), int(rng.integers(1, 3))
    return buildings.gabled_house(rng, bays, rng.uniform(8, 10), storeys, facade)


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("suburb", _network(rng), rng, relief_m=0.45)
    site.lay_ground("grass")
    edge = _STREET.pavement_m
    for k, street in enumerate(site.network.streets):
        site.wired_poles(street, side=1 if k % 2 else -1)
        site.frontage(street, _house, setback_m=(5.0, 8.0), gap_m=(4.0, 9.0))
        drives(site, street, 17.0)
        site.row(street, edge + 0.9, 7.0, partial(furniture.fence, length_m=6.0))
        site.row(street, edge + 1.1, 9.0, partial(vegetation.hedge, length_m=5.0))
        site.row(street, 0.4, 36.0, furniture.lamp_post)
        site.row(street, 0.4, 44.0, furniture.sign_post)
        site.row(street, edge - 0.35, 28.0, furniture.litter_bin)
        site.row(street, edge + 3.2, 13.0, vegetation.broadleaf)

        # What grows and stands in the gardens takes the room that is left.
        site.in_gardens(street, 16, vegetation.broadleaf, (3.5, 26.0))
        site.in_gardens(street, 4, vegetation.conifer, (3.0, 26.0))
        site.in_gardens(street, 2, vegetation.bare_tree, (2.5, 14.0))
        site.in_gardens(street, 8, vegetation.bush, (1.5, 20.0))
        site.in_gardens(street, 2, buildings.shed, (12.0, 26.0))
        site.in_gardens(street, 1, furniture.bench, (2.0, 12.0))

    site.outskirts(22, _house)
    site.outskirts(44, vegetation.broadleaf)
    return site.finished()
