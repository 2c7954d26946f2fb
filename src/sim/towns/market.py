"""Market quarter under construction: a square of stalls between alleys without cars, streets that
leave it like the vanes of a windmill, shells, scaffolds and a tower crane."""

from functools import partial

import numpy as np

from ..assets import buildings, construction, furniture, placed, plaza, upright, vegetation
from ..layout import Town
from ..solid import Rng, Solid
from ..textures import BAY_M, STOREY_M
from .network import ROAD_RISE_M, Network, Profile, Street, straight
from .parking import park
from .polyline import Spot
from .streetscape import Streetscape

_STREET = Profile(7.0, "road_2lane", 3.6, "paving_warm", 7.0, 2.3, 6.0)
_ALLEY = Profile(10.5, "cobbles", 0.0, "cobbles", None, 2.2, 5.0)
_PLASTER = ("facade_plaster_cream", "facade_plaster_ochre", "facade_plaster_rose")
_FACADES = (*_PLASTER, "facade_brick", "facade_panel")

# Half the sides of the two squares that the streets form.
_SQUARE_M, _RIM_M = (21.5, 23.0), (78.0, 82.0)
# The side of the alleys that looks away from the square.
_OUTSIDE = (-1,)


def _network(rng: Rng) -> Network:
    """Four alleys around a square; each goes on as a street to the rim, eight streets long."""
    yaw = rng.uniform(0, np.pi / 2)
    inner, outer = rng.uniform(*_SQUARE_M), rng.uniform(*_RIM_M)
    side = [(inner, -inner), (outer, -inner), (outer, outer)]

    # The corner of the square, where its street meets the rim, and the rim's corner after that;
    # complex numbers turn all three by quarters of a circle.
    turns = np.exp(1j * (yaw + np.arange(4) * np.pi / 2))
    corners = np.outer([x + 1j * y for x, y in side], turns).ravel()
    junctions = np.stack([corners.real, corners.imag], axis=1)
    junctions[4:] += rng.uniform(-2, 2, (8, 2))

    after = [1, 2, 3, 0]
    pairs = [(k, 4 + k) for k in range(4)] + [(4 + k, 8 + k) for k in range(4)]
    pairs += [(8 + k, 4 + after[k]) for k in range(4)]
    alleys = straight(junctions, [(k, after[k]) for k in range(4)], _ALLEY)
    return Network(junctions, alleys + straight(junctions, pairs, _STREET))


def _house(rng: Rng) -> list[Solid]:
    facade, depth = rng.choice(_FACADES), rng.uniform(8, 11)
    bays, storeys = int(rng.integers(3, 6)), int(rng.integers(2, 5))
    style = buildings.tower if rng.random() < 0.5 else buildings.apartment
    return style(rng, bays, depth, storeys, facade)


def _house_or_works(rng: Rng) -> list[Solid]:
    """A finished house, a shell, or a house behind a scaffold."""
    if rng.random() >= 0.55:
        return _house(rng)
    if rng.random() < 0.4:
        return construction.shell(rng)

    facade, depth = rng.choice(_FACADES), rng.uniform(8, 11)
    bays, storeys = int(rng.integers(3, 6)), int(rng.integers(2, 5))
    house = buildings.gabled_house(rng, bays, depth, storeys, facade)
    # The scaffold stands along the whole front, to below the eaves.
    lifts = int(storeys * STOREY_M // construction.LIFT_M) - 1
    scaffold = construction.scaffold(bays * BAY_M, lifts)
    return house + placed(scaffold, upright(depth / 2 + 0.8, 0.0))


# ------------------------------------------------------------------------------------ the square


def _square(site: Streetscape) -> None:
    """Between the alleys: cobbles, strings of lights, two halls, stalls along all sides."""
    rng = site.rng
    corners = np.array([street.points_m[0] for street in site.network.streets[:4]])
    along = corners[1] - corners[0]
    side_m = float(np.linalg.norm(along)) - _ALLEY.road_m
    middle = Spot(*corners.mean(axis=0).tolist(), float(np.arctan2(along[1], along[0])))
    site.lay(*middle, (side_m, side_m), ROAD_RISE_M, "cobbles")
    site.place(plaza.festoon(rng, side_m / 2 - 0.6, 8), *middle)
    for out_m in (-6.5, 6.5):
        site.place(plaza.market_hall(rng), *middle.moved(out_m, 0.0))

    # A few places in the rows of stalls stay empty.
    for quarter in np.arange(4) * np.pi / 2:
        for left_m in np.arange(4.0 - side_m / 2, side_m / 2 - 3.5, 3.7):
            if rng.random() < 0.85:
                front = middle.moved(0.0, 0.0, quarter).moved(side_m / 2 - 1.6, left_m)
                site.place(furniture.stall(rng), *front)


# ---------------------------------------------------------------------- streets, building sites


def _string(rng: Rng, width_m: float) -> list[Solid]:
    """A cable across a street with pennants, bulbs or a lamp."""
    make = furniture.span_wire if rng.random() < 0.3 else plaza.bunting
    return make(rng, width_m=width_m)


def _furnish_alley(site: Streetscape, alley: Street) -> None:
    site.row(alley, -0.8, 3.6, furniture.stall, _OUTSIDE)
    site.row(alley, 0.4, 14.0, furniture.litter_bin)
    site.row(alley, 0.5, 12.0, furniture.bench, _OUTSIDE)


def _furnish_street(site: Streetscape, street: Street) -> None:
    edge = street.profile.pavement_m
    site.row(street, 0.5, 30.0, furniture.lamp_post)
    site.row(street, 0.5, 34.0, furniture.sign_post)
    park(site, street, 0.15)

    # Between the pavement and the houses there is trade, and what the builders need.
    site.row(street, edge + 1.4, 11.0, furniture.stall)
    site.row(street, edge + 0.5, 11.0, partial(construction.site_fence, length_m=7.8))
    site.row(street, edge + 1.0, 15.0, furniture.barrier)
    site.row(street, edge + 0.5, 11.0, furniture.traffic_cone)
    site.row(street, edge + 1.5, 13.0, construction.supplies)
    site.row(street, edge + 1.6, 22.0, construction.skip)
    site.row(street, edge + 0.7, 20.0, furniture.litter_bin)
    site.in_gardens(street, 2, furniture.container, (6.0, 24.0))
    site.in_gardens(street, 3, construction.supplies, (6.0, 24.0))
    site.in_gardens(street, 3, vegetation.broadleaf, (8.0, 26.0))
    site.in_gardens(street, 2, vegetation.bare_tree, (3.0, 26.0))
    site.in_gardens(street, 3, vegetation.bush, (2.0, 20.0))


def _crane(site: Streetscape) -> None:
    """A tower crane in one of the blocks between the square and the rim."""
    rng, corners = site.rng, site.network.junctions_m
    for k in rng.permutation(4):
        # From the square's corner a block reaches to the rim's.
        x, y = 0.5 * corners[k] + 0.5 * corners[8 + k] + rng.uniform(-3, 3, 2)
        if site.place(construction.tower_crane(rng), x, y, rng.uniform(0, 2 * np.pi)):
            return


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("market", _network(rng), rng, relief_m=0.4)
    site.lay_ground("earth")
    alleys, streets = site.network.streets[:4], site.network.streets[4:]
    _square(site)
    for street in alleys + streets:
        width_m = 2 * street.profile.half_m + 0.3
        site.across(street, 11.0, partial(_string, width_m=width_m))
    _crane(site)

    for alley in alleys:
        site.frontage(alley, _house_or_works, (0.8, 1.4), (0.3, 4.0), _OUTSIDE)
    for street in streets:
        site.frontage(street, _house_or_works, setback_m=(2.6, 3.8), gap_m=(0.5, 6.0))
    for alley in alleys:
        _furnish_alley(site, alley)
    for street in streets:
        _furnish_street(site, street)
    site.outskirts(34, _house)
    site.outskirts(30, vegetation.broadleaf)
    return site.finished()
