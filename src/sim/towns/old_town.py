"""Old town: narrow crooked streets on cobbles, houses wall to wall, wires and lamps overhead."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import Network, Profile, Street
from .parking import drives
from .polyline import Point, Polyline
from .streetscape import Streetscape

_STREET = Profile(6.0, "cobbles", 1.8, "paving_warm", 6.0, 2.0, 5.5)
_FACADES = ("facade_plaster_cream", "facade_plaster_ochre", "facade_plaster_rose", "facade_brick")


def _network(rng: Rng) -> Network:
    """A jittered three by three mesh whose streets bend once or twice."""
    grid = np.array([(x, y) for y in (-62.0, 0.0, 62.0) for x in (-70.0, 0.0, 70.0)])
    junctions = grid + rng.uniform(-9, 9, grid.shape)
    pairs = [(k, k + 1) for k in range(9) if k % 3 < 2] + [(k, k + 3) for k in range(6)]
    streets = tuple(Street(a, b, _crooked(rng, *junctions[[a, b]]), _STREET) for a, b in pairs)
    return Network(junctions, streets)


def _crooked(rng: Rng, start: Point, end: Point) -> Polyline:
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    bends = [start + f * along + rng.uniform(-5, 5) * across for f in (0.36, 0.64)]
    return np.array([start, *bends, end])


def _house(rng: Rng) -> list[Solid]:
    facade, storeys = rng.choice(_FACADES), int(rng.integers(2, 5))
    bays, depth = int(rng.integers(2, 5)), rng.uniform(8, 11)
    style = buildings.apartment if rng.random() < 0.35 else buildings.gabled_house
    return style(rng, bays, depth, storeys, facade)


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("old_town", _network(rng), rng, relief_m=0.5)
    site.lay_ground("grass_dry")
    streets, edge = site.network.streets, _STREET.pavement_m

    # Cables hang between posts at the house walls, so they come before the houses.
    span = partial(furniture.span_wire, width_m=2 * _STREET.half_m + 0.3)
    for street in streets:
        site.across(street, 13.0, span, shortest_m=12)
    for street in streets:
        site.frontage(street, _house, setback_m=(0.5, 0.9), gap_m=(0.0, 1.2))

    for street in streets:
        site.row(street, 0.35, 22.0, furniture.sign_post)
        site.row(street, 0.3, 30.0, partial(furniture.railing, length_m=4.0))
        site.row(street, edge + 0.4, 9.0, furniture.litter_bin)
        site.row(street, edge + 0.5, 16.0, furniture.bench)
        drives(site, street, 16.0)
        site.row(street, edge + 1.5, 12.0, furniture.stall)
        site.row(street, edge + 1.2, 10.0, vegetation.bush)
        site.row(street, edge + 1.4, 14.0, vegetation.street_tree)
        site.in_gardens(street, 6, vegetation.broadleaf, (9.0, 26.0))
        site.in_gardens(street, 2, vegetation.bare_tree, (3.0, 26.0))

    site.outskirts(40, _house)
    site.outskirts(24, vegetation.broadleaf)
    return site.finished()
