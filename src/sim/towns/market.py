"""Market quarter under construction: a square of stalls between alleys without cars, streets that
leave it like the vanes of a windmill, shells, scaffolds and a tower crane."""

from functools import partial

import numpy as np

from ..assets import buildings, construction, furniture, market, placed, upright, vegetation
from ..layout import GroundPatch, Town
from ..solid import Solid
from ..textures import BAY_M, STOREY_M
from .network import ROAD_RISE_M, Network, Profile, Street
from .parking import park
from .site import Site
from .streetscape import (
    Spot,
    across,
    frontage,
    in_gardens,
    lay_ground,
    outskirts,
    row,
    stand,
)
from .terrain import rolling

_STREET = Profile(7.0, "road_2lane", 3.6, "paving_warm", 7.0, 2.3, 6.0)
_ALLEY = Profile(10.5, "cobbles", 0.0, "cobbles", None, 2.2, 5.0)
_FACADES = (
    "facade_plaster_cream",
    "facade_plaster_ochre",
    "facade_plaster_rose",
    "facade_brick",
    "facade_panel",
)
_SQUARE_M, _RIM_M = (21.5, 23.0), (78.0, 82.0)
"""Half the sides of the two squares that the streets form."""

_SQUARE = slice(0, 4)
_OUTSIDE = (-1,)
"""Which streets are the alleys around the square, and which of their sides looks away from it."""


def _network(rng: np.random.Generator) -> Network:
    """Four alleys around a square; each goes on as a street to the rim, eight streets long."""
    yaw = rng.uniform(0, np.pi / 2)
    inner, outer = rng.uniform(*_SQUARE_M), rng.uniform(*_RIM_M)
    side = [(inner, -inner), (outer, -inner), (outer, outer)]
    turns = np.exp(1j * (yaw + np.arange(4) * np.pi / 2))
    # The corner of the square, where its street meets the rim, and the rim's corner after that.
    corners = np.outer([x + 1j * y for x, y in side], turns).ravel()
    junctions = np.stack([corners.real, corners.imag], axis=1)
    junctions[4:] += rng.uniform(-2, 2, (8, 2))
    after = [1, 2, 3, 0]
    pairs = [
        *((k, after[k], _ALLEY) for k in range(4)),
        *((k, 4 + k, _STREET) for k in range(4)),
        *((4 + k, 8 + k, _STREET) for k in range(4)),
        *((8 + k, 4 + after[k], _STREET) for k in range(4)),
    ]
    streets = (Street(a, b, junctions[[a, b]], profile) for a, b, profile in pairs)
    return Network(junctions, tuple(streets))


def _house(rng: np.random.Generator) -> list[Solid]:
    facade, depth = str(rng.choice(_FACADES)), float(rng.uniform(8, 11))
    bays, storeys = int(rng.integers(3, 6)), int(rng.integers(2, 5))
    style = buildings.tower if rng.random() < 0.5 else buildings.apartment
    return style(rng, bays, depth, storeys, facade)


def _works(rng: np.random.Generator) -> list[Solid]:
    """A shell, or a house behind a scaffold."""
    if rng.random() < 0.4:
        return construction.shell(rng)
    facade, depth = str(rng.choice(_FACADES)), float(rng.uniform(8, 11))
    bays, storeys = int(rng.integers(3, 6)), int(rng.integers(2, 5))
    return buildings.gabled_house(rng, bays, depth, storeys, facade) + _scaffold(
        depth, bays, storeys
    )


def _house_or_works(rng: np.random.Generator) -> list[Solid]:
    return (_works if rng.random() < 0.55 else _house)(rng)


def _scaffold(depth_m: float, bays: int, storeys: int) -> list[Solid]:
    """A scaffold along the whole front of a house, to below its eaves."""
    lifts = int(storeys * STOREY_M // construction.LIFT_M) - 1
    return placed(construction.scaffold(bays * BAY_M, lifts), upright(depth_m / 2 + 0.8, 0.0))


# ------------------------------------------------------------------------------------ the square


def _square(site: Site, rng: np.random.Generator) -> None:
    """Between the alleys: cobbles, strings of lights, two halls, stalls along all sides."""
    corners = np.array([street.points_m[0] for street in site.network.streets[_SQUARE]])
    along = corners[1] - corners[0]
    side_m = float(np.linalg.norm(along)) - _ALLEY.road_m
    middle = Spot(*corners.mean(axis=0).tolist(), float(np.arctan2(along[1], along[0])))
    place_m = (middle.x_m, middle.y_m)
    site.ground.append(GroundPatch(place_m, middle.yaw_rad, side_m, side_m, ROAD_RISE_M, "cobbles"))
    stand(site, market.festoon(rng, side_m / 2 - 0.6, 8), middle)
    for out_m in (-6.5, 6.5):
        stand(site, market.hall(rng), middle.moved(out_m, 0.0))
    for quarter in np.arange(4) * np.pi / 2:
        for left_m in np.arange(4.0 - side_m / 2, side_m / 2 - 3.5, 3.7):
            if rng.random() < 0.85:
                front = middle.moved(0.0, 0.0, quarter).moved(side_m / 2 - 1.6, left_m)
                stand(site, furniture.stall(rng), front)


# ---------------------------------------------------------------------- streets, building sites


def _string(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """A cable across a street with pennants, bulbs or a lamp."""
    make = furniture.span_wire if rng.random() < 0.3 else market.bunting
    return make(rng, width_m=width_m)


def _furnish_alley(site: Site, alley: Street, rng: np.random.Generator) -> None:
    row(site, alley, -0.8, 3.6, furniture.stall, rng, _OUTSIDE)
    row(site, alley, 0.4, 14.0, furniture.litter_bin, rng)
    row(site, alley, 0.5, 12.0, furniture.bench, rng, _OUTSIDE)


def _furnish_street(site: Site, street: Street, rng: np.random.Generator) -> None:
    edge = street.profile.pavement_m
    row(site, street, 0.5, 30.0, furniture.lamp_post, rng)
    row(site, street, 0.5, 34.0, furniture.sign_post, rng)
    park(site, street, rng, 0.15)
    row(site, street, edge + 1.4, 11.0, furniture.stall, rng)
    row(site, street, edge + 0.5, 11.0, partial(construction.site_fence, length_m=7.8), rng)
    row(site, street, edge + 1.0, 15.0, furniture.barrier, rng)
    row(site, street, edge + 0.5, 11.0, furniture.traffic_cone, rng)
    row(site, street, edge + 1.5, 13.0, construction.supplies, rng)
    row(site, street, edge + 1.6, 22.0, construction.skip, rng)
    row(site, street, edge + 0.7, 20.0, furniture.litter_bin, rng)
    in_gardens(site, street, 2, furniture.container, rng, (6.0, 24.0))
    in_gardens(site, street, 3, construction.supplies, rng, (6.0, 24.0))
    in_gardens(site, street, 3, vegetation.broadleaf, rng, (8.0, 26.0))
    in_gardens(site, street, 2, vegetation.bare_tree, rng, (3.0, 26.0))
    in_gardens(site, street, 3, vegetation.bush, rng, (2.0, 20.0))


def _crane(site: Site, rng: np.random.Generator) -> None:
    """A tower crane in one of the blocks between the square and the rim."""
    corners = site.network.junctions_m
    for k in rng.permutation(4):
        # From the square's corner a block reaches to the rim's.
        x, y = 0.5 * corners[k] + 0.5 * corners[8 + k] + rng.uniform(-3, 3, 2)
        if site.place(construction.tower_crane(rng), x, y, rng.uniform(0, 2 * np.pi)):
            return


def build(rng: np.random.Generator) -> Town:
    site = Site("market", _network(rng), rolling(rng, 0.4))
    lay_ground(site, "earth")
    _square(site, rng)
    for street in site.network.streets:
        width_m = 2 * street.profile.half_m + 0.3
        across(site, street, 11.0, partial(_string, width_m=width_m), rng)
    _crane(site, rng)
    alleys, streets = site.network.streets[_SQUARE], site.network.streets[_SQUARE.stop :]
    for alley in alleys:
        frontage(site, alley, _house_or_works, rng, (0.8, 1.4), (0.3, 4.0), _OUTSIDE)
    for street in streets:
        frontage(site, street, _house_or_works, rng, setback_m=(2.6, 3.8), gap_m=(0.5, 6.0))
    for alley in alleys:
        _furnish_alley(site, alley, rng)
    for street in streets:
        _furnish_street(site, street, rng)
    outskirts(site, 34, _house, rng)
    outskirts(site, 30, vegetation.broadleaf, rng)
    return site.finished()
