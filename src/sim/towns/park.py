"""Park: lawns, trees and gravel paths with lamps and benches, within a ring of streets."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import Network, Profile, Street, bowed, straight
from .parking import park
from .streetscape import TWO_LANES, Streetscape

_PATH = Profile(4.0, "gravel", 0.0, "gravel", None, 2.4, 6.0)
_FACADES = ("facade_brick", "facade_plaster_cream", "facade_panel")


def _network(rng: Rng) -> Network:
    """Eight junctions on a ring of streets, and four winding paths to the middle."""
    corners = np.array([(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)], dtype=float)
    junctions = corners * (78.0, 68.0) + rng.uniform(-5, 5, (9, 2))
    ring = [(0, 1), (1, 2), (0, 3), (2, 5), (3, 6), (5, 8), (6, 7), (7, 8)]
    streets = straight(junctions, ring, TWO_LANES)
    paths = bowed(rng, junctions, [(k, 4) for k in (1, 3, 5, 7)], _PATH, (10, 18))
    return Network(junctions, streets + paths)


def _villa(rng: Rng) -> list[Solid]:
    facade, depth = rng.choice(_FACADES), rng.uniform(10, 13)
    return buildings.apartment(rng, int(rng.integers(4, 7)), depth, int(rng.integers(3, 6)), facade)


def _outer_side(street: Street) -> int:
    """Returns which side of a ring street looks away from the park."""
    (x, y), (dx, dy) = street.points_m.mean(axis=0), street.points_m[-1] - street.points_m[0]
    return -1 if dx * -y - dy * -x > 0 else 1


def _furnish_street(site: Streetscape, street: Street) -> None:
    outer = _outer_side(street)
    edge = street.profile.pavement_m
    site.frontage(street, _villa, (3.0, 6.0), (8.0, 20.0), sides=(outer,))
    site.row(street, 0.55, 28.0, furniture.lamp_post)
    site.row(street, 0.5, 40.0, furniture.sign_post)

    # The park is fenced; the villas on the other side have hedges.
    site.row(street, edge + 0.5, 6.6, partial(furniture.fence, length_m=6.4), (-outer,))
    site.row(street, edge + 0.9, 9.0, partial(vegetation.hedge, length_m=6.0), (outer,))
    site.row(street, edge + 3.0, 8.0, vegetation.broadleaf)
    site.row(street, 0.9, 14.0, vegetation.street_tree)
    park(site, street, 0.2)


def _furnish_path(site: Streetscape, path: Street) -> None:
    site.row(path, 0.9, 14.0, furniture.park_lamp)
    site.row(path, 0.8, 17.0, furniture.bench)
    site.row(path, 0.8, 26.0, furniture.litter_bin)
    site.in_gardens(path, 3, furniture.climbing_frame, (3.0, 12.0))
    site.in_gardens(path, 1, buildings.kiosk, (3.0, 8.0))
    site.in_gardens(path, 1, furniture.stall, (2.0, 6.0))
    site.in_gardens(path, 6, vegetation.bare_tree, (2.0, 25.0))
    site.in_gardens(path, 26, vegetation.broadleaf, (2.5, 30.0))
    site.in_gardens(path, 10, vegetation.conifer, (2.5, 30.0))
    site.in_gardens(path, 14, vegetation.bush, (1.0, 25.0))


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("park", _network(rng), rng, relief_m=0.5)
    site.lay_ground("grass")
    for street in site.network.streets:
        furnish = _furnish_path if street.profile is _PATH else _furnish_street
        furnish(site, street)
    site.outskirts(16, _villa)
    site.outskirts(40, vegetation.broadleaf)
    return site.finished()
