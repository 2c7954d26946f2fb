"""Squares of a campus and a market: teaching blocks, arcades, an open hall, flags, banners,
pennants, strings of lights, fountains, sculptures, planters, bike racks.

Fronts look along +x, as everywhere beside a street.
"""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colors
from ..solid import Rng, Solid
from .buildings import FOUNDATION_M, block
from .furniture import wire
from .parts import Vector, beam, box, boxes, part, placed, posts, upright
from .vegetation import broadleaf

# Height of the glazed ground floor of a slab.
_LOBBY_M = 3.6

# ---------------------------------------------------------------------------------- buildings


def slab(rng: Rng, bays: int, storeys: int, facade: str) -> list[Solid]:
    """A long teaching block; its glazed ground floor lies back behind a row of columns."""
    width, depth = bays * colors.BAY_M, rng.uniform(10.0, 13.0)
    top = _LOBBY_M + storeys * colors.STOREY_M
    lobby_m = (depth - 2.0, width - 1.0, _LOBBY_M + FOUNDATION_M)

    # Columns along the front carry the storeys above the lobby.
    ys = np.linspace(-0.48, 0.48, max(3, bays // 2 + 1)) * width
    return [
        box(BUILDING, "facade_glass", lobby_m, (-0.9, 0, (_LOBBY_M - FOUNDATION_M) / 2)),
        block(facade, depth, width, _LOBBY_M, top),
        box(BUILDING, "roof_flat", (depth + 0.3, width + 0.3, 0.4), (0, 0, top + 0.2)),
        *posts(BUILDING, "concrete", 0.45, [(depth / 2 - 0.4, y) for y in ys], _LOBBY_M),
        box(BUILDING, "corrugated_grey", (0.3 * depth, 0.4 * width, 1.6), (-1, 0, top + 1.2)),
    ]


def linked_slabs(rng: Rng, bays: int, storeys: int, facade: str) -> list[Solid]:
    """Two slabs side by side and, over the passage between them, a glazed footbridge."""
    passage = rng.uniform(8.0, 11.0)
    out = (bays * colors.BAY_M + passage) / 2
    solids = []
    for y in (-out, out):
        solids += placed(slab(rng, bays, storeys, facade), upright(0.0, y))

    # A floor, glazed walls as one box, and a roof.
    under, length = _LOBBY_M + 0.3, passage + 0.4
    bridge = (
        ("concrete", (2.4, length, 0.4), (0, 0, under + 0.2)),
        ("facade_glass", (2.4, length, 2.7 - 0.4), (0, 0, under + (0.4 + 2.7) / 2)),
        ("roof_flat", (2.8, length, 0.25), (0, 0, under + 2.8)),
    )
    return solids + boxes(BUILDING, bridge)


def arcade(rng: Rng, length_m: float) -> list[Solid]:
    """A covered walk along y: a thin roof on slim steel columns."""
    height, half = rng.uniform(3.1, 3.5), length_m / 2
    ys = np.linspace(-half + 0.3, half - 0.3, max(2, round(length_m / 4.0) + 1))
    feet_m = [(x, y) for x in (-1.2, 1.2) for y in ys]
    return [
        box(BUILDING, "concrete", (3.0, length_m, 0.25), (0, 0, height)),
        *posts(THIN_STRUCTURE, colors.METAL[2], 0.16, feet_m, height - 0.1),
    ]


def market_hall(rng: Rng) -> list[Solid]:
    """An open market hall along y: a tiled roof on timber posts."""
    length, run, eaves, pitch = rng.uniform(12.0, 15.0), 4.6, 3.4, 0.42
    tiles = rng.choice(["roof_tiles", "roof_slate"])
    frames = np.linspace(-0.46, 0.46, 5) * length
    solids = []
    for y in frames:
        solids.append(beam(BUILDING, colors.TIMBER, 0.2, (-3.9, y, eaves), (3.9, y, eaves)))
        solids += posts(BUILDING, colors.TIMBER, 0.26, [(-3.7, y), (3.7, y)], eaves + 0.35)

    # The roof is laid in pieces between the frames, and reaches beyond the first and the last.
    slope_m = (run / np.cos(pitch) + 0.2, length / 4, 0.18)
    for side in (-1, 1):
        for y in (frames[1:] + frames[:-1]) / 2 / 0.92:
            middle = (side * run / 2, y, eaves + run / 2 * np.tan(pitch))
            solids.append(box(BUILDING, tiles, slope_m, middle, 0.0, side * pitch))
    return solids


# ------------------------------------------------------------------------------ thin structures


def flag_pole(rng: Rng) -> list[Solid]:
    """A pole of 8 to 10 m with a flag along y."""
    height, paint = rng.uniform(8.0, 10.0), rng.choice(colors.BUS_PAINT)
    return [
        *posts(THIN_STRUCTURE, colors.METAL[3], 0.12, [(0, 0)], height),
        box(THIN_STRUCTURE, paint, (0.05, 1.6, 1.0), (0, 0.85, height - 0.7)),
    ]


def bike_rack(rng: Rng) -> list[Solid]:
    """A row of hoops along y."""
    metal, hoops = colors.METAL[2], int(rng.integers(4, 8))
    solids = []
    for y in (np.arange(hoops) - (hoops - 1) / 2) * 0.8:
        solids += posts(THIN_STRUCTURE, metal, 0.06, [(-0.35, y), (0.35, y)], 0.83)
        solids.append(beam(THIN_STRUCTURE, metal, 0.06, (-0.38, y, 0.8), (0.38, y, 0.8)))
    return solids


def banner_line(rng: Rng, width_m: float) -> list[Solid]:
    """Two masts along x across a walk, and a banner between two cables."""
    height, half = rng.uniform(7.2, 7.8), width_m / 2
    cables = []
    for z in (height, height - 1.1):
        cables += wire((-half, 0, z), (half, 0, z), 0.08)

    paint = rng.choice(colors.BUS_PAINT)
    size_m = (rng.uniform(0.3, 0.6) * width_m, 0.04, 1.1)
    return [
        *posts(THIN_STRUCTURE, colors.METAL[2], 0.16, [(-half, 0), (half, 0)], height + 0.2),
        *cables,
        box(THIN_STRUCTURE, paint, size_m, (0, 0, height - 0.63)),
    ]


def bunting(rng: Rng, width_m: float) -> list[Solid]:
    """Two poles along x across a whole street, and a line of pennants or bulbs between them."""
    height, half, sag = rng.uniform(6.4, 7.4), width_m / 2, rng.uniform(0.3, 0.6)
    poles = posts(THIN_STRUCTURE, colors.METAL[0], 0.14, [(-half, 0), (half, 0)], height + 0.1)
    cable = wire((-half, 0.0, height), (half, 0.0, height), sag)
    if rng.random() >= 0.6:
        return [*poles, *cable, *_bulbs(cable)]

    joints = _joints(cable)
    paints = rng.choice(colors.SHIRTS, len(joints))
    pennants = ((p, (0.32, 0.03, 0.42), (x, y, z - 0.2)) for p, (x, y, z) in zip(paints, joints))
    return [*poles, *cable, *boxes(THIN_STRUCTURE, pennants)]


def festoon(rng: Rng, radius_m: float, spokes: int) -> list[Solid]:
    """A mast in the middle of a square, and strings of lights from it to poles all around."""
    top, low = rng.uniform(8.2, 9.0), rng.uniform(5.8, 6.4)
    metal = colors.METAL[0]
    solids = posts(THIN_STRUCTURE, metal, 0.24, [(0, 0)], top + 0.3)

    for angle in np.arange(spokes) * 2 * np.pi / spokes:
        x, y = radius_m * np.cos(angle), radius_m * np.sin(angle)
        cable = wire((0, 0, top), (x, y, low), rng.uniform(0.3, 0.6))
        solids += posts(THIN_STRUCTURE, metal, 0.14, [(x, y)], low + 0.1)
        solids += [*cable, *_bulbs(cable)]
    return solids


def _joints(cable: list[Solid]) -> list[Vector]:
    """Returns the middles of the pieces of a cable, and where they meet."""
    middles = [piece.scene_from_solid[:3, 3] for piece in cable]
    return [*middles, *((a + b) / 2 for a, b in pairwise(middles))]


def _bulbs(cable: list[Solid]) -> list[Solid]:
    rows = ((colors.HEADLIGHT, (0.14, 0.14, 0.18), (x, y, z - 0.08)) for x, y, z in _joints(cable))
    return boxes(THIN_STRUCTURE, rows)


# ------------------------------------------------------------------------------------- general


def sculpture(rng: Rng) -> list[Solid]:
    """Something abstract on a plinth."""
    metal = rng.choice([*colors.METAL, colors.CHIMNEY])
    solids = [box(GENERAL, "stone", (1.6, 1.6, 1.0), (0, 0, 0.3))]

    # Two or three shapes, each sunk a little into the one below.
    z = 0.8
    for _ in range(int(rng.integers(2, 4))):
        size = rng.uniform(0.7, 1.3)
        shape = str(rng.choice(["ellipsoid", "box", "cone"]))
        yaw = rng.uniform(0, np.pi)
        solids.append(part(shape, GENERAL, metal, (size, size, size), (0, 0, z + size / 2), yaw))
        z += 0.9 * size
    return solids


def fountain(rng: Rng) -> list[Solid]:
    """A round basin with water and a bowl on a stem."""
    width, bowl = rng.uniform(4.0, 5.5), rng.uniform(1.4, 2.0)
    height = rng.uniform(1.5, 2.2)
    solids = [part("cylinder", GENERAL, "stone", (width, width, 0.8), (0, 0, 0.2))]

    # Material, diameter, bottom and top: the basin's water, the stem, the bowl and its water.
    for material, size, low, high in (
        ("water", width - 0.5, 0.5, 0.63),
        ("stone", 0.5, 0.5, height),
        ("stone", bowl, height, height + 0.25),
        ("water", bowl - 0.2, height + 0.2, height + 0.28),
    ):
        size_m = (size, size, high - low)
        solids.append(part("cylinder", GENERAL, material, size_m, (0, 0, (low + high) / 2)))
    return solids


def bollards(rng: Rng) -> list[Solid]:
    """A row of steel bollards along y."""
    count = int(rng.integers(3, 6))
    ys = (np.arange(count) - (count - 1) / 2) * 1.5
    return posts(GENERAL, colors.METAL[1], 0.22, [(0, y) for y in ys], 0.95)


def planter(rng: Rng) -> list[Solid]:
    """A concrete tub with a clipped shrub."""
    size = rng.uniform(1.2, 1.8)
    crown = (size + 0.1, size + 0.1, rng.uniform(0.8, 1.3))
    return [
        box(GENERAL, "concrete", (size, size, 0.9), (0, 0, 0.25)),
        part("ellipsoid", VEGETATION, "foliage_mid", crown, (0, 0, 0.7 + crown[2] / 2)),
    ]


def tree_planter(rng: Rng) -> list[Solid]:
    """A broad concrete tub, low enough to sit on, with a tree."""
    tub = box(GENERAL, "concrete", (2.4, 2.4, 0.75), (0, 0, 0.15))
    return [tub, *broadleaf(rng, max_radius_m=2.2, trunk_m=2.4)]
