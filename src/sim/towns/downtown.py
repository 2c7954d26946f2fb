"""Downtown: a grid of wide roads between tall blocks, with traffic lights, lamps and trees."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import Network, Street, straight
from .parking import park
from .streetscape import FOUR_LANES, TWO_LANES, Streetscape

_FACADES = ("facade_concrete", "facade_panel", "facade_glass", "facade_brick", "facade_brick_dark")


def _network(rng: Rng) -> Network:
    """Three by three junctions; the two streets through the middle are avenues."""
    xs = np.array([-1, 0, 1]) * rng.uniform(72, 90, 3)
    ys = np.array([-1, 0, 1]) * rng.uniform(66, 80, 3)
    junctions = np.array([(x, y) for y in ys for x in xs])

    # From each junction one street goes east and one north, but not off the grid.
    pairs = sorted([(k, k + 1) for k in range(9) if k % 3 < 2] + [(k, k + 3) for k in range(6)])
    avenues = {3, 4, 5}, {1, 4, 7}
    streets: list[Street] = []
    for pair in pairs:
        is_avenue = any(avenue.issuperset(pair) for avenue in avenues)
        streets += straight(junctions, [pair], FOUR_LANES if is_avenue else TWO_LANES)
    return Network(junctions, tuple(streets), lights=True)


def _block(rng: Rng) -> list[Solid]:
    facade = rng.choice(_FACADES)
    bays, storeys = int(rng.integers(4, 9)), int(rng.integers(4, 16))
    return buildings.tower(rng, bays, rng.uniform(12, 18), storeys, facade)


def _furnish(site: Streetscape, street: Street) -> None:
    edge = street.profile.pavement_m
    site.row(street, 0.55, 27.0, furniture.lamp_post)
    site.row(street, 0.9, 11.0, vegetation.street_tree)
    site.row(street, 0.5, 38.0, furniture.sign_post)
    park(site, street, 0.2)
    site.row(street, 0.7, 33.0, furniture.litter_bin)
    site.row(street, 0.7, 40.0, furniture.bench)
    site.row(street, 0.4, 45.0, partial(furniture.railing, length_m=6.0))

    # Between the pavement and the blocks.
    site.row(street, edge + 1.0, 12.0, vegetation.bush)
    site.row(street, edge + 3.0, 30.0, furniture.container)
    site.row(street, edge + 1.4, 24.0, furniture.barrier)
    site.row(street, edge + 1.2, 18.0, furniture.traffic_cone)


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("downtown", _network(rng), rng, relief_m=0.3)
    site.lay_ground("paving")
    site.traffic_lights()
    for street in site.network.streets:
        site.frontage(street, _block, setback_m=(0.5, 2.0), gap_m=(0.5, 7.0))

    # Small things come after the buildings, and find room between them.
    for street in site.network.streets:
        _furnish(site, street)
    site.outskirts(26, _block)
    return site.finished()
