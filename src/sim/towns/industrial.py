"""Industrial yard: wide concrete roads between long halls, tanks and container stacks, with pipe
bridges overhead, mesh fences, floodlight masts and power lines."""

from functools import partial

import numpy as np

from ..assets import furniture, industry, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import lot, park
from .polyline import arc_m
from .site import Site
from .streetscape import (
    frontage,
    in_gardens,
    lay_ground,
    outskirts,
    row,
    spots,
    wired_poles,
)
from .terrain import rolling

_STREET = Profile(8.0, "road_wide", 3.7, "concrete", 8.0, 3.0, 7.5)


def _network(rng: np.random.Generator) -> Network:
    """Two long roads side by side, joined by four short ones."""
    xs = np.array([-135.0, -48.0, 44.0, 130.0])
    junctions = np.array([(x, y) for y in (-46.0, 46.0) for x in xs]) + rng.uniform(-7, 7, (8, 2))
    pairs = [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7), (0, 4), (1, 5), (2, 6), (3, 7)]
    streets = (Street(a, b, junctions[[a, b]], _STREET) for a, b in pairs)
    return Network(junctions, tuple(streets))


def _works(rng: np.random.Generator) -> list[Solid]:
    kind = rng.random()
    if kind < 0.62:
        return industry.hall(rng, float(rng.uniform(18, 34)), float(rng.uniform(13, 19)))
    return industry.tank(rng) if kind < 0.82 else industry.silo(rng)


def _overhead(site: Site, street: Street, rng: np.random.Generator) -> None:
    """Pipe bridges across the street."""
    line = site.network.open_m(street)
    bridge = partial(industry.pipe_bridge, width_m=2 * street.profile.half_m + 0.8)
    if arc_m(line)[-1] > 20:
        for spot in spots(line, 1e-3, 34.0, rng):
            site.place(bridge(rng), spot.x_m, spot.y_m, spot.yaw_rad)


def _furnish(site: Site, street: Street, rng: np.random.Generator) -> None:
    edge = street.profile.pavement_m
    row(site, street, edge + 0.6, 7.4, partial(industry.mesh_fence, length_m=7.0), rng)
    row(site, street, edge + 1.2, 36.0, industry.floodlight_mast, rng)
    row(site, street, 0.5, 42.0, furniture.sign_post, rng)
    row(site, street, 0.5, 34.0, furniture.lamp_post, rng)
    park(site, street, rng, 0.2)
    row(site, street, edge + 3.0, 9.0, industry.container_stack, rng)
    row(site, street, edge + 1.6, 13.0, furniture.barrier, rng)
    in_gardens(site, street, 3, furniture.container, rng, (6.0, 26.0))
    in_gardens(site, street, 3, vegetation.broadleaf, rng, (4.0, 26.0))
    in_gardens(site, street, 3, vegetation.bush, rng, (2.0, 20.0))
    in_gardens(site, street, 1, vegetation.bare_tree, rng, (3.0, 20.0))


def build(rng: np.random.Generator) -> Town:
    site = Site("industrial", _network(rng), rolling(rng, 0.3))
    lay_ground(site, "concrete")
    for k, street in enumerate(site.network.streets):
        _overhead(site, street, rng)
        wired_poles(site, street, 1 if k % 2 else -1, rng)
    lot(site, (-92.0, 0.0), 0.0, rng, columns=11, share=0.6)
    lot(site, (88.0, 0.0), 0.0, rng, columns=9, share=0.6, kind="truck")
    for middle in ((-2.0, 0.0), (-2.0, 18.0)):
        site.place(industry.gantry_crane(rng), *middle, float(np.pi / 2))
    site.place(industry.chimney(rng), 60.0, 8.0, 0.0)
    for street in site.network.streets:
        frontage(site, street, _works, rng, setback_m=(4.5, 8.0), gap_m=(4.0, 12.0))
    for street in site.network.streets:
        _furnish(site, street, rng)
    outskirts(site, 22, _works, rng)
    outskirts(site, 24, vegetation.broadleaf, rng)
    return site.finished()
