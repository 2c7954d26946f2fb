"""Old town: narrow crooked streets on cobbles, houses wall to wall, wires and lamps overhead."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import drives
from .polyline import arc_m
from .site import Site
from .streetscape import frontage, in_gardens, lay_ground, outskirts, row, spots
from .terrain import rolling

_STREET = Profile(6.0, "cobbles", 1.8, "paving_warm", 6.0, 2.0, 5.5)
_FACADES = ("facade_plaster_cream", "facade_plaster_ochre", "facade_plaster_rose", "facade_brick")


def _network(rng: np.random.Generator) -> Network:
    """A jittered three by three mesh whose streets bend once or twice."""
    grid = np.array([(x, y) for y in (-62.0, 0.0, 62.0) for x in (-70.0, 0.0, 70.0)])
    junctions = grid + rng.uniform(-9, 9, grid.shape)
    pairs = [(k, k + 1) for k in range(9) if k % 3 < 2] + [(k, k + 3) for k in range(6)]
    streets = tuple(Street(a, b, _crooked(rng, *junctions[[a, b]]), _STREET) for a, b in pairs)
    return Network(junctions, streets)


def _crooked(rng: np.random.Generator, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    bends = [start + f * along + rng.uniform(-5, 5) * across for f in (0.36, 0.64)]
    return np.array([start, *bends, end])


def _house(rng: np.random.Generator) -> list[Solid]:
    facade, storeys = str(rng.choice(_FACADES)), int(rng.integers(2, 5))
    bays, depth = int(rng.integers(2, 5)), float(rng.uniform(8, 11))
    style = buildings.apartment if rng.random() < 0.35 else buildings.gabled_house
    return style(rng, bays, depth, storeys, facade)


def _overhead(site: Site, street: Street, rng: np.random.Generator) -> None:
    """Cables across the street, each between two posts at the house walls."""
    line = site.network.open_m(street)
    span = partial(furniture.span_wire, width_m=2 * street.profile.half_m + 0.3)
    if arc_m(line)[-1] > 12:
        for spot in spots(line, 1e-3, 13.0, rng):
            site.place(span(rng), spot.x_m, spot.y_m, spot.yaw_rad)


def build(rng: np.random.Generator) -> Town:
    site = Site("old_town", _network(rng), rolling(rng, 0.5))
    lay_ground(site, "grass_dry")
    for street in site.network.streets:
        _overhead(site, street, rng)
    for street in site.network.streets:
        frontage(site, street, _house, rng, setback_m=(0.5, 0.9), gap_m=(0.0, 1.2))
    for street in site.network.streets:
        edge = _STREET.pavement_m
        row(site, street, 0.35, 22.0, furniture.sign_post, rng)
        row(site, street, 0.3, 30.0, partial(furniture.railing, length_m=4.0), rng)
        row(site, street, edge + 0.4, 9.0, furniture.litter_bin, rng)
        row(site, street, edge + 0.5, 16.0, furniture.bench, rng)
        drives(site, street, rng, 16.0)
        row(site, street, edge + 1.5, 12.0, furniture.stall, rng)
        row(site, street, edge + 1.2, 10.0, vegetation.bush, rng)
        row(site, street, edge + 1.4, 14.0, vegetation.street_tree, rng)
        in_gardens(site, street, 6, vegetation.broadleaf, rng, (9.0, 26.0))
        in_gardens(site, street, 2, vegetation.bare_tree, rng, (3.0, 26.0))
    outskirts(site, 40, _house, rng)
    outskirts(site, 24, vegetation.broadleaf, rng)
    return site.finished()
