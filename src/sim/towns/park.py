"""Park: lawns, trees and gravel paths with lamps and benches, within a ring of streets."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import park
from .polyline import turn
from .site import Site
from .streetscape import TWO_LANES, frontage, in_gardens, lay_ground, outskirts, row
from .terrain import rolling

_PATH = Profile(4.0, "gravel", 0.0, "gravel", None, 2.4, 6.0)
_FACADES = ("facade_brick", "facade_plaster_cream", "facade_panel")


def _network(rng: np.random.Generator) -> Network:
    """Eight junctions on a ring of streets, and four winding paths to the middle."""
    corners = np.array([(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)], dtype=float)
    junctions = corners * (78.0, 68.0) + rng.uniform(-5, 5, (9, 2))
    streets = []
    for start, end in ((0, 1), (1, 2), (0, 3), (2, 5), (3, 6), (5, 8), (6, 7), (7, 8)):
        streets.append(Street(start, end, junctions[[start, end]], TWO_LANES))
    for start in (1, 3, 5, 7):
        a, b = junctions[start], junctions[4]
        bow = rng.choice([-1, 1]) * rng.uniform(10, 18)
        across = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        streets.append(Street(start, 4, turn(a, (a + b) / 2 + bow * across, b, 9), _PATH))
    return Network(junctions, tuple(streets))


def _villa(rng: np.random.Generator) -> list[Solid]:
    facade, depth = str(rng.choice(_FACADES)), float(rng.uniform(10, 13))
    return buildings.apartment(rng, int(rng.integers(4, 7)), depth, int(rng.integers(3, 6)), facade)


def _outer_side(street: Street) -> int:
    """Which side of a ring street looks away from the park."""
    (x, y), (dx, dy) = street.points_m.mean(axis=0), street.points_m[-1] - street.points_m[0]
    return -1 if dx * -y - dy * -x > 0 else 1


def _furnish_street(site: Site, street: Street, rng: np.random.Generator) -> None:
    outer = _outer_side(street)
    edge = street.profile.pavement_m
    frontage(site, street, _villa, rng, (3.0, 6.0), (8.0, 20.0), sides=(outer,))
    row(site, street, 0.55, 28.0, furniture.lamp_post, rng)
    row(site, street, 0.5, 40.0, furniture.sign_post, rng)
    row(site, street, edge + 0.5, 6.6, partial(furniture.fence, length_m=6.4), rng, (-outer,))
    row(site, street, edge + 0.9, 9.0, partial(vegetation.hedge, length_m=6.0), rng, (outer,))
    row(site, street, edge + 3.0, 8.0, vegetation.broadleaf, rng)
    row(site, street, 0.9, 14.0, vegetation.street_tree, rng)
    park(site, street, rng, 0.2)


def _furnish_path(site: Site, path: Street, rng: np.random.Generator) -> None:
    row(site, path, 0.9, 14.0, furniture.park_lamp, rng)
    row(site, path, 0.8, 17.0, furniture.bench, rng)
    row(site, path, 0.8, 26.0, furniture.litter_bin, rng)
    in_gardens(site, path, 3, furniture.climbing_frame, rng, (3.0, 12.0))
    in_gardens(site, path, 1, buildings.kiosk, rng, (3.0, 8.0))
    in_gardens(site, path, 1, furniture.stall, rng, (2.0, 6.0))
    in_gardens(site, path, 6, vegetation.bare_tree, rng, (2.0, 25.0))
    in_gardens(site, path, 26, vegetation.broadleaf, rng, (2.5, 30.0))
    in_gardens(site, path, 10, vegetation.conifer, rng, (2.5, 30.0))
    in_gardens(site, path, 14, vegetation.bush, rng, (1.0, 25.0))


def build(rng: np.random.Generator) -> Town:
    site = Site("park", _network(rng), rolling(rng, 0.5))
    lay_ground(site, "grass")
    for street in site.network.streets:
        furnish = _furnish_path if street.profile is _PATH else _furnish_street
        furnish(site, street, rng)
    outskirts(site, 16, _villa, rng)
    outskirts(site, 40, vegetation.broadleaf, rng)
    return site.finished()
