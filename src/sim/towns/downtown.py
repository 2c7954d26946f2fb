"""Downtown: a grid of wide roads between tall blocks, with signals, lamps and street trees."""

from functools import partial

import numpy as np

from ..assets import buildings, furniture, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Street
from .parking import park
from .site import Site
from .streetscape import FOUR_LANES, TWO_LANES, frontage, lay_ground, outskirts, row, signals
from .terrain import rolling

_FACADES = ("facade_concrete", "facade_panel", "facade_glass", "facade_brick", "facade_brick_dark")


def _network(rng: np.random.Generator) -> Network:
    """Three by three junctions; the two streets through the middle are avenues."""
    xs = np.array([-1, 0, 1]) * rng.uniform(72, 90, 3)
    ys = np.array([-1, 0, 1]) * rng.uniform(66, 80, 3)
    junctions = np.array([(x, y) for y in ys for x in xs])
    streets = []
    for k in range(9):
        if k % 3 < 2:
            wide = FOUR_LANES if k // 3 == 1 else TWO_LANES
            streets.append(Street(k, k + 1, junctions[[k, k + 1]], wide))
        if k // 3 < 2:
            wide = FOUR_LANES if k % 3 == 1 else TWO_LANES
            streets.append(Street(k, k + 3, junctions[[k, k + 3]], wide))
    return Network(junctions, tuple(streets), signals=True)


def _block(rng: np.random.Generator) -> list[Solid]:
    facade = str(rng.choice(_FACADES))
    bays, storeys = int(rng.integers(4, 9)), int(rng.integers(4, 16))
    return buildings.tower(rng, bays, float(rng.uniform(12, 18)), storeys, facade)


def _furnish(site: Site, street: Street, rng: np.random.Generator) -> None:
    row(site, street, 0.55, 27.0, furniture.lamp_post, rng)
    row(site, street, 0.9, 11.0, vegetation.street_tree, rng)
    row(site, street, 0.5, 38.0, furniture.sign_post, rng)
    park(site, street, rng, 0.2)
    row(site, street, 0.7, 33.0, furniture.litter_bin, rng)
    row(site, street, 0.7, 40.0, furniture.bench, rng)
    row(site, street, 0.4, 45.0, partial(furniture.railing, length_m=6.0), rng)
    row(site, street, street.profile.pavement_m + 1.0, 12.0, vegetation.bush, rng)
    row(site, street, street.profile.pavement_m + 3.0, 30.0, furniture.container, rng)
    row(site, street, street.profile.pavement_m + 1.4, 24.0, furniture.barrier, rng)
    row(site, street, street.profile.pavement_m + 1.2, 18.0, furniture.traffic_cone, rng)


def build(rng: np.random.Generator) -> Town:
    site = Site("downtown", _network(rng), rolling(rng, 0.3))
    lay_ground(site, "paving")
    signals(site, rng)
    for street in site.network.streets:
        frontage(site, street, _block, rng, setback_m=(0.5, 2.0), gap_m=(0.5, 7.0))
    for street in site.network.streets:
        _furnish(site, street, rng)
    outskirts(site, 26, _block, rng)
    return site.finished()
