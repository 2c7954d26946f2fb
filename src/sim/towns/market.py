"""Market quarter under construction: stalls and bunting in narrow streets around a square, shells,
scaffolds, hoardings and a tower crane."""

from functools import partial

import numpy as np

from ..assets import buildings, construction, furniture, vegetation
from ..layout import Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import park
from .polyline import arc_m
from .site import Site
from .streetscape import frontage, in_gardens, lay_ground, outskirts, row, spots
from .terrain import rolling

_STREET = Profile(7.0, "road_2lane", 3.2, "paving_warm", 7.0, 2.3, 6.0)
_ALLEY = Profile(5.0, "cobbles", 0.0, "cobbles", None, 2.1, 5.0)
_FACADES = ("facade_plaster_ochre", "facade_plaster_rose", "facade_brick", "facade_panel")
_CORNERS = 5


def _network(rng: np.random.Generator) -> Network:
    """A pentagon of streets with bent sides, two streets and three alleys to the square inside."""
    angle = np.linspace(0, 2 * np.pi, _CORNERS + 1)[:-1] + rng.uniform(0, 0.3)
    rim = 86.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + rng.uniform(
        -5, 5, (_CORNERS, 2)
    )
    junctions = np.concatenate([rim, rng.uniform(-5, 5, (1, 2))])
    streets = []
    for k in range(_CORNERS):
        after = (k + 1) % _CORNERS
        a, b = junctions[k], junctions[after]
        out = (a + b) / np.linalg.norm(a + b)
        bend = (a + b) / 2 + out * rng.uniform(3, 9)
        streets.append(Street(k, after, np.stack([a, bend, b]), _STREET))
        inner = _STREET if k in (0, 2) else _ALLEY
        streets.append(Street(k, _CORNERS, junctions[[k, _CORNERS]], inner))
    return Network(junctions, tuple(streets))


def _house(rng: np.random.Generator) -> list[Solid]:
    if rng.random() < 0.28:
        return construction.shell(rng)
    facade, bays = str(rng.choice(_FACADES)), int(rng.integers(3, 6))
    style = buildings.tower if rng.random() < 0.5 else buildings.apartment
    return style(rng, bays, float(rng.uniform(8, 11)), int(rng.integers(2, 5)), facade)


def _overhead(site: Site, street: Street, rng: np.random.Generator) -> None:
    """Bunting and lamps on cables across the street."""
    line = site.network.open_m(street)
    width_m = 2 * street.profile.half_m + (0.3 if street.profile.pavement_m else 1.2)
    if arc_m(line)[-1] > 12:
        for k, spot in enumerate(spots(line, 1e-3, 11.0, rng)):
            make = furniture.span_wire if k % 3 == 2 else construction.bunting
            site.place(make(rng, width_m=width_m), spot.x_m, spot.y_m, spot.yaw_rad)


def _furnish(site: Site, street: Street, rng: np.random.Generator) -> None:
    edge = street.profile.pavement_m
    alley = street.profile is _ALLEY
    row(site, street, edge + 1.3, 4.2 if alley else 9.0, furniture.stall, rng)
    row(site, street, edge + 0.7, 16.0, partial(construction.scaffold, length_m=7.5), rng)
    row(site, street, edge + 0.8, 10.0, partial(construction.hoarding, length_m=7.8), rng)
    row(site, street, edge + 1.0, 14.0, furniture.barrier, rng)
    row(site, street, edge + 0.9, 9.0, furniture.traffic_cone, rng)
    row(site, street, edge + 1.6, 12.0, construction.material_stack, rng)
    row(site, street, edge + 2.6, 22.0, furniture.container, rng)
    row(site, street, edge + 0.8, 20.0, furniture.litter_bin, rng)
    if not alley:
        row(site, street, 0.5, 34.0, furniture.sign_post, rng)
        row(site, street, 0.5, 30.0, furniture.lamp_post, rng)
        park(site, street, rng, 0.6)
    in_gardens(site, street, 4, vegetation.broadleaf, rng, (8.0, 26.0))
    in_gardens(site, street, 2, vegetation.bare_tree, rng, (3.0, 26.0))
    in_gardens(site, street, 4, vegetation.bush, rng, (2.0, 20.0))


def build(rng: np.random.Generator) -> Town:
    site = Site("market", _network(rng), rolling(rng, 0.4))
    lay_ground(site, "gravel")
    for street in site.network.streets:
        _overhead(site, street, rng)
    for turn in rng.uniform(0, 2 * np.pi) + np.arange(40) * 2.4:
        if site.place(construction.tower_crane(rng), 34 * np.cos(turn), 34 * np.sin(turn), turn):
            break
    for street in site.network.streets:
        gap_m = (3.0, 9.0) if street.profile is _ALLEY else (0.5, 5.0)
        frontage(site, street, _house, rng, setback_m=(2.6, 3.8), gap_m=gap_m)
    for street in site.network.streets:
        _furnish(site, street, rng)
    outskirts(site, 34, _house, rng)
    outskirts(site, 30, vegetation.broadleaf, rng)
    return site.finished()
