"""Industrial yard: wide concrete roads between long halls, tanks and container stacks, with pipe
bridges overhead, mesh fences, floodlight masts and power lines."""

from functools import partial

import numpy as np

from ..assets import furniture, industry, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from .network import Network, Profile, Street, straight
from .parking import lot, park
from .polyline import Spot
from .streetscape import Streetscape

_STREET = Profile(8.0, "road_wide", 3.7, "concrete", 8.0, 3.0, 7.5)


def _network(rng: Rng) -> Network:
    """Two long roads side by side, joined by four short ones."""
    xs = np.array([-135.0, -48.0, 44.0, 130.0])
    junctions = np.array([(x, y) for y in (-46.0, 46.0) for x in xs]) + rng.uniform(-7, 7, (8, 2))
    pairs = [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7), (0, 4), (1, 5), (2, 6), (3, 7)]
    return Network(junctions, straight(junctions, pairs, _STREET))


def _works(rng: Rng) -> list[Solid]:
    kind = rng.random()
    if kind < 0.62:
        return industry.hall(rng, rng.uniform(18, 34), rng.uniform(13, 19))
    return industry.tank(rng) if kind < 0.82 else industry.silo(rng)


def _furnish(site: Streetscape, street: Street) -> None:
    edge = street.profile.pavement_m
    site.row(street, edge + 0.6, 7.4, partial(industry.mesh_fence, length_m=7.0))
    site.row(street, edge + 1.2, 36.0, industry.floodlight_mast)
    site.row(street, 0.5, 42.0, furniture.sign_post)
    site.row(street, 0.5, 34.0, furniture.lamp_post)
    park(site, street, 0.2)
    site.row(street, edge + 3.0, 9.0, industry.container_stack)
    site.row(street, edge + 1.6, 13.0, furniture.barrier)

    # Little grows here, and far from the road.
    site.in_gardens(street, 3, furniture.container, (6.0, 26.0))
    site.in_gardens(street, 3, vegetation.broadleaf, (4.0, 26.0))
    site.in_gardens(street, 3, vegetation.bush, (2.0, 20.0))
    site.in_gardens(street, 1, vegetation.bare_tree, (3.0, 20.0))


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("industrial", _network(rng), rng, relief_m=0.3)
    site.lay_ground("concrete")
    bridge = partial(industry.pipe_bridge, width_m=2 * _STREET.half_m + 0.8)
    for k, street in enumerate(site.network.streets):
        site.across(street, 34.0, bridge, shortest_m=20)
        site.wired_poles(street, 1 if k % 2 else -1)

    # The yard between the two roads: lots at its ends, cranes and a chimney in its middle.
    lot(site, Spot(-92.0, 0.0, 0.0), columns=11, share=0.6, kind="car")
    lot(site, Spot(88.0, 0.0, 0.0), columns=9, share=0.6, kind="truck")
    for y in (0.0, 18.0):
        site.place(industry.gantry_crane(rng), -2.0, y, np.pi / 2)
    site.place(industry.chimney(rng), 60.0, 8.0, 0.0)

    for street in site.network.streets:
        site.frontage(street, _works, setback_m=(4.5, 8.0), gap_m=(4.0, 12.0))
    for street in site.network.streets:
        _furnish(site, street)
    site.outskirts(22, _works)
    site.outskirts(24, vegetation.broadleaf)
    return site.finished()
