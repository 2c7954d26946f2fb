"""Waterfront: a quay with boats on one side, warehouses and flats on the other, and an elevated
road on columns that crosses the streets between them."""

from functools import partial

import numpy as np
from jaxtyping import Float

from ...ontology import BUILDING
from ..assets import buildings, furniture, industry, placed, upright, vegetation, waterside
from ..assets.parts import box
from ..layout import Town
from ..solid import Rng, Solid
from .ground import BASE_TILE_M, MARGIN_M
from .network import Network, Profile, Street, straight
from .parking import park
from .streetscape import BOTH, TWO_LANES, Streetscape

_QUAY = Profile(7.0, "road_2lane", 5.0, "paving_warm", 9.0, 3.0, 7.5)
_QUAY_Y_M, _INLAND_Y_M, _DECK_Y_M = -46.0, 42.0, -4.0
# The water's edge, 13 m from the middle of the quay's road, and how deep the water lies.
_SHORE_Y_M = _QUAY_Y_M - 13.0
_WATER_RISE_M = -1.2

# The elevated road: its underside, its width, its pieces, and where its level part ends.
_DECK_UNDER_M, _DECK_WIDTH_M, _DECK_PIECE_M = 5.9, 8.0, 12.0
_HALF_DECK_PIECES, _RAMP_PIECES = 12, 4
_HALF_DECK_M = _HALF_DECK_PIECES * _DECK_PIECE_M
_RAMP_SLOPE = 0.13
_FACADES = ("facade_glass", "facade_panel", "facade_brick", "facade_plaster_cream")

# The quay's streets run eastwards: the water is on their right, houses are on their left.
_WATER, _LAND = (-1,), (1,)


def _network(rng: Rng) -> Network:
    """A straight quay of four junctions, three junctions inland between them, and a zigzag."""
    quay = [(x, _QUAY_Y_M) for x in (-138.0, -46.0, 46.0, 138.0)]
    xs = (-92.0, 0.0, 92.0)
    inland = [(x + rng.uniform(-8, 8), _INLAND_Y_M + rng.uniform(-5, 5)) for x in xs]
    junctions = np.array(quay + inland)
    pairs = [(4, 5), (5, 6), (0, 4), (4, 1), (1, 5), (5, 2), (2, 6), (6, 3)]
    quays = straight(junctions, [(k, k + 1) for k in range(3)], _QUAY)
    return Network(junctions, quays + straight(junctions, pairs, TWO_LANES))


def _flats(rng: Rng) -> list[Solid]:
    facade, bays = rng.choice(_FACADES), int(rng.integers(4, 7))
    if rng.random() < 0.3:
        return industry.hall(rng, rng.uniform(15, 22), rng.uniform(11, 14))
    return buildings.apartment(rng, bays, rng.uniform(10, 13), int(rng.integers(3, 8)), facade)


def _lay_water(site: Streetscape) -> None:
    """Water in the place of the ground beyond the shore, behind a quay wall."""
    tiles = [
        patch
        for patch in site.ground
        if patch.width_m == BASE_TILE_M and patch.origin_m[1] - BASE_TILE_M / 2 < _SHORE_Y_M
    ]
    site.ground = [patch for patch in site.ground if patch not in tiles]

    # Each column of tiles becomes a strip of dry ground and a longer one of water.
    top_y = max(patch.origin_m[1] for patch in tiles) + BASE_TILE_M / 2
    far_m = MARGIN_M + 10.0
    for x in sorted({patch.origin_m[0] for patch in tiles}):
        dry_m, sea_m = (BASE_TILE_M, top_y - _SHORE_Y_M), (BASE_TILE_M, far_m)
        site.lay(x, (_SHORE_Y_M + top_y) / 2, 0.0, dry_m, 0.0, "paving_warm")
        site.lay(x, _SHORE_Y_M - far_m / 2, 0.0, sea_m, _WATER_RISE_M, "water")
    for x in np.arange(-190.0, 190.0, 4.0):
        wall = box(BUILDING, "stone", (4.0, 0.5, 2.0), (0, 0, -0.75))
        site.place([wall], float(x), _SHORE_Y_M - 0.2, 0.0)


def _moor(site: Streetscape) -> None:
    """Boats along the quay wall and jetties between them, afloat."""
    rng, x = site.rng, -150.0
    while x < 150:
        kind = rng.random()
        if kind < 0.2:
            make, out_m, turned_rad = partial(waterside.jetty, length_m=14.0), 0.5, 0.0
        else:
            make = waterside.motor_boat if kind < 0.65 else waterside.sailing_boat
            # A boat swings at its rope; a jetty is built straight.
            out_m, turned_rad = rng.uniform(2.4, 5.0), rng.normal(0, 0.04)
        site.place(make(rng), x, _SHORE_Y_M - out_m, np.pi / 2 + turned_rad, _WATER_RISE_M)
        x += rng.uniform(7.0, 12.0)


# ------------------------------------------------------------------------------ the elevated road


def _overpass(site: Streetscape) -> None:
    """The elevated road, above every corridor that it crosses, on columns where there is room,
    and the ramps at its ends."""
    pieces = _HALF_DECK_PIECES + _RAMP_PIECES
    for x_m in (np.arange(-pieces, pieces) + 0.5) * _DECK_PIECE_M:
        ramp_m = max(abs(x_m) - _HALF_DECK_M, 0.0)
        under_m = _DECK_UNDER_M - ramp_m * _RAMP_SLOPE
        _stand_columns(site, x_m, under_m)

        # Local y of a piece is west, so a positive tilt about x rises towards the west.
        tilt_rad = np.sign(x_m) * np.arctan(_RAMP_SLOPE) if ramp_m else 0.0
        world_from_piece = upright(x_m, _DECK_Y_M, under_m, np.pi / 2) @ _tilted(tilt_rad)
        piece = waterside.deck(_DECK_PIECE_M / np.cos(tilt_rad), _DECK_WIDTH_M)
        ground_m = site.height_m(x_m, _DECK_Y_M)
        site.hang(placed(piece, world_from_piece), ground_m, overhead=True)

        # Lamps stand along the level part alone.
        if not ramp_m:
            lamp = furniture.lamp_post(site.rng)
            edge_y_m = _DECK_Y_M + _DECK_WIDTH_M / 2 - 0.15
            foot_m = _DECK_UNDER_M + waterside.DECK_M + 0.4
            site.hang(placed(lamp, upright(x_m + 4.0, edge_y_m, foot_m, -np.pi / 2)), ground_m)


def _stand_columns(site: Streetscape, x_m: float, under_m: float) -> None:
    """A pair of columns under the middle of a piece, or a little beside it, if anywhere."""
    if under_m < 1.0:
        return
    for step_m in (0.0, 3.0, -3.0):
        height_m = under_m - site.height_m(x_m + step_m, _DECK_Y_M)
        # Where the deck slopes, what stands downhill is shorter.
        slope = _RAMP_SLOPE if abs(x_m) > _HALF_DECK_M else 0.0
        feet = waterside.columns(_DECK_WIDTH_M, height_m - slope * np.sign(x_m) * step_m)
        if site.place(feet, x_m + step_m, _DECK_Y_M, np.pi / 2):
            return


def _tilted(angle_rad: float) -> Float[np.ndarray, "4 4"]:
    """A turn about x that lifts what lies along y."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1, 0, 0, 0], [0, cos, -sin, 0], [0, sin, cos, 0], [0, 0, 0, 1.0]])


# --------------------------------------------------------------------------------- along the ways


def _furnish(site: Streetscape, street: Street) -> None:
    quay, edge = street.profile is _QUAY, street.profile.pavement_m
    gardens = _LAND if quay else BOTH
    site.row(street, 0.55, 24.0, furniture.lamp_post)
    site.row(street, 0.5, 40.0, furniture.sign_post)
    if quay:
        site.row(street, 8.6, 6.3, partial(furniture.railing, length_m=6.0), _WATER)
        site.row(street, 9.0, 11.0, waterside.bollard, _WATER)
        site.row(street, 5.8, 13.0, waterside.palm, _WATER)
        site.row(street, 6.4, 15.0, furniture.bench, _WATER)
        site.row(street, 7.0, 55.0, waterside.quay_crane, _WATER)
        site.row(street, 7.2, 30.0, industry.floodlight_mast, _WATER)
        site.row(street, 5.6, 48.0, buildings.kiosk, _WATER)

    site.row(street, 0.9, 12.0, vegetation.street_tree)
    park(site, street, 0.2)
    site.row(street, edge + 1.0, 15.0, vegetation.bush)
    site.row(street, edge + 1.2, 24.0, furniture.litter_bin)
    site.row(street, edge + 2.4, 30.0, industry.container_stack, _LAND)
    site.in_gardens(street, 7, vegetation.broadleaf, (3.0, 26.0), gardens)
    site.in_gardens(street, 2, vegetation.bare_tree, (3.0, 16.0), gardens)


def build(rng: Rng) -> Town:
    """Builds the town; the generator decides its details."""
    site = Streetscape("waterfront", _network(rng), rng, relief_m=0.25)
    site.lay_ground("paving")
    _lay_water(site)
    _overpass(site)

    for street in site.network.streets:
        sides = _LAND if street.profile is _QUAY else BOTH
        site.frontage(street, _flats, (1.0, 3.0), (3.0, 10.0), sides)
    for street in site.network.streets:
        _furnish(site, street)
    _moor(site)
    site.outskirts(26, _flats, south_m=_QUAY_Y_M)
    site.outskirts(30, vegetation.broadleaf, south_m=_QUAY_Y_M)
    return site.finished()
