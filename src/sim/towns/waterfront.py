"""Waterfront: a quay with boats on one side, warehouses and flats on the other, and an elevated
road on columns that crosses the streets between them."""

from functools import partial

import numpy as np
from jaxtyping import Float

from ..assets import buildings, furniture, industry, vegetation, waterside
from ..assets.parts import placed, upright
from ..layout import GroundPatch, Town
from ..solid import Solid
from .network import Network, Profile, Street
from .parking import park
from .site import Site
from .streetscape import (
    BASE_TILE_M,
    MARGIN_M,
    TWO_LANES,
    frontage,
    in_gardens,
    lay_ground,
    outskirts,
    row,
)
from .terrain import rolling

_QUAY = Profile(7.0, "road_2lane", 5.0, "paving_warm", 9.0, 3.0, 7.5)
_QUAY_Y_M, _INLAND_Y_M, _DECK_Y_M = -46.0, 42.0, -4.0
_SHORE_M = 13.0
"""From the middle of the quay's road to the water's edge."""
_WATER_RISE_M = -1.2
_DECK_UNDER_M, _DECK_WIDTH_M, _DECK_PIECE_M = 5.9, 8.0, 12.0
_DECK_PIECES, _RAMP_PIECES = 24, 4
_RAMP_SLOPE = 0.13
_FACADES = ("facade_glass", "facade_panel", "facade_brick", "facade_plaster_cream")


def _network(rng: np.random.Generator) -> Network:
    """A straight quay of four junctions, three junctions inland between them, and a zigzag."""
    quay = [(x, _QUAY_Y_M) for x in (-138.0, -46.0, 46.0, 138.0)]
    inland = [
        (x + rng.uniform(-8, 8), _INLAND_Y_M + rng.uniform(-5, 5)) for x in (-92.0, 0.0, 92.0)
    ]
    junctions = np.array(quay + inland)
    streets = [Street(k, k + 1, junctions[[k, k + 1]], _QUAY) for k in range(3)]
    pairs = [(4, 5), (5, 6), (0, 4), (4, 1), (1, 5), (5, 2), (2, 6), (6, 3)]
    streets += [Street(a, b, junctions[[a, b]], TWO_LANES) for a, b in pairs]
    return Network(junctions, tuple(streets))


def _flats(rng: np.random.Generator) -> list[Solid]:
    facade, bays = str(rng.choice(_FACADES)), int(rng.integers(4, 7))
    if rng.random() < 0.3:
        return industry.hall(rng, float(rng.uniform(15, 22)), float(rng.uniform(11, 14)))
    return buildings.apartment(
        rng, bays, float(rng.uniform(10, 13)), int(rng.integers(3, 8)), facade
    )


def _lay_water(site: Site) -> None:
    """Water in the place of the ground beyond the shore, behind a quay wall."""
    shore_y = _QUAY_Y_M - _SHORE_M
    whole = [
        patch
        for patch in site.ground
        if not (patch.width_m == BASE_TILE_M and patch.origin_m[1] - BASE_TILE_M / 2 < shore_y)
    ]
    tiles = [patch for patch in site.ground if patch not in whole]
    top_y = max(patch.origin_m[1] for patch in tiles) + BASE_TILE_M / 2
    for x in sorted({patch.origin_m[0] for patch in tiles}):
        strip = ((x, (shore_y + top_y) / 2), 0.0, BASE_TILE_M, top_y - shore_y, 0.0, "paving_warm")
        whole.append(GroundPatch(*strip))
        far_m = MARGIN_M + 10.0
        sea = ((x, shore_y - far_m / 2), 0.0, BASE_TILE_M, far_m, _WATER_RISE_M, "water")
        whole.append(GroundPatch(*sea))
    site.ground = whole
    for x in np.arange(-190.0, 190.0, 4.0):
        wall = buildings.part("box", buildings.BUILDING, "stone", (4.0, 0.5, 2.0), (0, 0, -0.75))
        site.place([wall], float(x), shore_y - 0.2, 0.0)


def _moor(site: Site, rng: np.random.Generator) -> None:
    """Boats along the quay wall and jetties between them, afloat."""
    x, shore_y = -150.0, _QUAY_Y_M - _SHORE_M
    while x < 150:
        kind = rng.random()
        if kind < 0.2:
            make, out_m = partial(waterside.jetty, length_m=14.0), 0.5
        else:
            make = waterside.motor_boat if kind < 0.65 else waterside.sailing_boat
            out_m = rng.uniform(2.4, 5.0)
        yaw = np.pi / 2 if kind < 0.2 else np.pi / 2 + rng.normal(0, 0.04)
        site.place(make(rng), x, shore_y - out_m, float(yaw), _WATER_RISE_M)
        x += rng.uniform(7.0, 12.0)


def _overpass(site: Site, rng: np.random.Generator) -> None:
    """The elevated road, above every corridor that it crosses, on columns where there is room,
    and the ramps at its ends."""
    top_m = _DECK_UNDER_M + waterside.DECK_M
    half = _DECK_PIECES // 2
    for k in range(-half - _RAMP_PIECES, half + _RAMP_PIECES):
        x_m = (k + 0.5) * _DECK_PIECE_M
        ramp_m = max(abs(x_m) - half * _DECK_PIECE_M, 0.0)
        under_m = _DECK_UNDER_M - ramp_m * _RAMP_SLOPE
        _stand_columns(site, x_m, under_m)
        # Local y of a piece is west, so a positive tilt about x rises towards the west.
        tilt_rad = np.sign(x_m) * np.arctan(_RAMP_SLOPE) if ramp_m else 0.0
        world_from_piece = upright(x_m, _DECK_Y_M, under_m, np.pi / 2) @ _tilted(tilt_rad)
        piece = waterside.deck(_DECK_PIECE_M / np.cos(tilt_rad), _DECK_WIDTH_M)
        ground_m = site.height_m(x_m, _DECK_Y_M)
        site.hang(placed(piece, world_from_piece), ground_m, overhead=True)
        if not ramp_m:
            lamp = furniture.lamp_post(rng)
            edge_y_m = _DECK_Y_M + _DECK_WIDTH_M / 2 - 0.15
            site.hang(placed(lamp, upright(x_m + 4.0, edge_y_m, top_m + 0.4, -np.pi / 2)), ground_m)


def _stand_columns(site: Site, x_m: float, under_m: float) -> None:
    """A pair of columns under the middle of a piece, or a little beside it, if anywhere."""
    if under_m < 1.0:
        return
    for step_m in (0.0, 3.0, -3.0):
        height_m = under_m - site.height_m(x_m + step_m, _DECK_Y_M)
        # Where the deck slopes, what stands downhill is shorter.
        slope = _RAMP_SLOPE if abs(x_m) > _DECK_PIECES // 2 * _DECK_PIECE_M else 0.0
        feet = waterside.columns(_DECK_WIDTH_M, height_m - slope * np.sign(x_m) * step_m)
        if site.place(feet, x_m + step_m, _DECK_Y_M, float(np.pi / 2)):
            return


def _tilted(angle_rad: float) -> Float[np.ndarray, "4 4"]:
    """A turn about x that lifts what lies along y."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1, 0, 0, 0], [0, cos, -sin, 0], [0, sin, cos, 0], [0, 0, 0, 1.0]])


def _furnish(site: Site, street: Street, rng: np.random.Generator) -> None:
    quay = street.profile is _QUAY
    row(site, street, 0.55, 24.0, furniture.lamp_post, rng)
    row(site, street, 0.5, 40.0, furniture.sign_post, rng)
    if quay:
        row(site, street, 8.6, 6.3, partial(furniture.railing, length_m=6.0), rng, (-1,))
        row(site, street, 9.0, 11.0, waterside.bollard, rng, (-1,))
        row(site, street, 5.8, 13.0, waterside.palm, rng, (-1,))
        row(site, street, 6.4, 15.0, furniture.bench, rng, (-1,))
        row(site, street, 7.0, 55.0, waterside.quay_crane, rng, (-1,))
        row(site, street, 7.2, 30.0, industry.floodlight_mast, rng, (-1,))
        row(site, street, 5.6, 48.0, buildings.kiosk, rng, (-1,))
    row(site, street, 0.9, 12.0, vegetation.street_tree, rng)
    park(site, street, rng, 0.2)
    row(site, street, street.profile.pavement_m + 1.0, 15.0, vegetation.bush, rng)
    row(site, street, street.profile.pavement_m + 1.2, 24.0, furniture.litter_bin, rng)
    row(site, street, street.profile.pavement_m + 2.4, 30.0, industry.container_stack, rng, (1,))
    in_gardens(site, street, 7, vegetation.broadleaf, rng, (3.0, 26.0), (1,) if quay else (-1, 1))
    in_gardens(site, street, 2, vegetation.bare_tree, rng, (3.0, 16.0), (1,) if quay else (-1, 1))


def build(rng: np.random.Generator) -> Town:
    site = Site("waterfront", _network(rng), rolling(rng, 0.25))
    lay_ground(site, "paving")
    _lay_water(site)
    _overpass(site, rng)
    for street in site.network.streets:
        sides = (1,) if street.profile is _QUAY else (-1, 1)
        frontage(site, street, _flats, rng, (1.0, 3.0), (3.0, 10.0), sides)
    for street in site.network.streets:
        _furnish(site, street, rng)
    _moor(site, rng)
    outskirts(site, 26, _flats, rng, south_m=_QUAY_Y_M)
    outskirts(site, 30, vegetation.broadleaf, rng, south_m=_QUAY_Y_M)
    return site.finished()
