"""A campus: teaching blocks, arcades, flags, banners, fountains, sculptures, planters, bike racks.

Fronts look along +x, as everywhere beside a street.
"""

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colours
from ..solid import Solid
from .buildings import FOUNDATION_M
from .furniture import wire
from .parts import ROOT_M, beam, part, placed, pose
from .vegetation import broadleaf

_LOBBY_M = 3.6
"""Height of the glazed ground floor of a slab."""

# ---------------------------------------------------------------------------------- buildings


def slab(rng: np.random.Generator, bays: int, storeys: int, facade: str) -> list[Solid]:
    """A long teaching block; its glazed ground floor lies back behind a row of columns."""
    width, depth = bays * colours.BAY_M, rng.uniform(10.0, 13.0)
    top = _LOBBY_M + storeys * colours.STOREY_M
    lobby = (depth - 2.0, width - 1.0, _LOBBY_M + FOUNDATION_M)
    middle = (-0.9, 0, (_LOBBY_M - FOUNDATION_M) / 2)
    upper = (depth, width, top - _LOBBY_M)
    solids = [
        part("box", BUILDING, "facade_glass", lobby, middle),
        part("box", BUILDING, facade, upper, (0, 0, (_LOBBY_M + top) / 2)),
        part("box", BUILDING, "roof_flat", (depth + 0.3, width + 0.3, 0.4), (0, 0, top + 0.2)),
    ]
    for y in np.linspace(-0.48, 0.48, max(3, bays // 2 + 1)) * width:
        foot = (depth / 2 - 0.4, y, ROOT_M), (depth / 2 - 0.4, y, _LOBBY_M)
        solids.append(beam(BUILDING, "concrete", *foot, 0.45))
    plant = (0.3 * depth, 0.4 * width, 1.6)
    return [*solids, part("box", BUILDING, "corrugated_grey", plant, (-1, 0, top + 1.2))]


def linked_slabs(rng: np.random.Generator, bays: int, storeys: int, facade: str) -> list[Solid]:
    """Two slabs side by side and, over the passage between them, a glazed footbridge."""
    passage = rng.uniform(8.0, 11.0)
    out = (bays * colours.BAY_M + passage) / 2
    solids = []
    for side in (-1, 1):
        solids += placed(slab(rng, bays, storeys, facade), pose(0.0, side * out))
    under, length = _LOBBY_M + 0.3, passage + 0.4
    for low, high, material in ((0.0, 0.4, "concrete"), (0.4, 2.7, "facade_glass")):
        size_m, z = (2.4, length, high - low), under + (low + high) / 2
        solids.append(part("box", BUILDING, material, size_m, (0, 0, z)))
    return [*solids, part("box", BUILDING, "roof_flat", (2.8, length, 0.25), (0, 0, under + 2.8))]


def arcade(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A covered walk along y: a thin roof on slim steel columns."""
    height, half = rng.uniform(3.1, 3.5), length_m / 2
    roof = part("box", BUILDING, "concrete", (3.0, length_m, 0.25), (0, 0, height))
    ys = np.linspace(-half + 0.3, half - 0.3, max(2, round(length_m / 4.0) + 1))
    columns = [((x, y, ROOT_M), (x, y, height - 0.1)) for x in (-1.2, 1.2) for y in ys]
    return [roof, *(beam(THIN_STRUCTURE, colours.METAL[2], *ends, 0.16) for ends in columns)]


# ------------------------------------------------------------------------------ thin structures


def flag_pole(rng: np.random.Generator) -> list[Solid]:
    """A pole of 8 to 10 m with a flag along y."""
    height, paint = rng.uniform(8.0, 10.0), str(rng.choice(colours.BUS_PAINT))
    pole = (0, 0, ROOT_M), (0, 0, height)
    flag = (0, 0.85, height - 0.7)
    return [
        beam(THIN_STRUCTURE, colours.METAL[3], *pole, 0.12),
        part("box", THIN_STRUCTURE, paint, (0.05, 1.6, 1.0), flag),
    ]


def bike_rack(rng: np.random.Generator) -> list[Solid]:
    """A row of hoops along y."""
    metal, hoops = colours.METAL[2], int(rng.integers(4, 8))
    solids = []
    for y in (np.arange(hoops) - (hoops - 1) / 2) * 0.8:
        ends = [((x, y, ROOT_M), (x, y, 0.83)) for x in (-0.35, 0.35)]
        ends.append(((-0.38, y, 0.8), (0.38, y, 0.8)))
        solids += [beam(THIN_STRUCTURE, metal, *pair, 0.06) for pair in ends]
    return solids


def banner_line(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Two masts along x across a walk, and a banner between two cables."""
    height, half = rng.uniform(7.2, 7.8), width_m / 2
    masts = [((x, 0, ROOT_M), (x, 0, height + 0.2)) for x in (-half, half)]
    solids = [beam(THIN_STRUCTURE, colours.METAL[2], *ends, 0.16) for ends in masts]
    for z in (height, height - 1.1):
        solids += wire((-half, 0, z), (half, 0, z), 0.08)
    paint, banner = str(rng.choice(colours.BUS_PAINT)), (0, 0, height - 0.63)
    size_m = (rng.uniform(0.3, 0.6) * width_m, 0.04, 1.1)
    return [*solids, part("box", THIN_STRUCTURE, paint, size_m, banner)]


# ------------------------------------------------------------------------------------- general


def sculpture(rng: np.random.Generator) -> list[Solid]:
    """Something abstract on a plinth."""
    metal = str(rng.choice([*colours.METAL, colours.CHIMNEY]))
    solids = [part("box", GENERAL, "stone", (1.6, 1.6, 1.0), (0, 0, 0.3))]
    z = 0.8
    for _ in range(int(rng.integers(2, 4))):
        size = rng.uniform(0.7, 1.3)
        shape = str(rng.choice(["ellipsoid", "box", "cone"]))
        yaw = rng.uniform(0, np.pi)
        solids.append(part(shape, GENERAL, metal, (size, size, size), (0, 0, z + size / 2), yaw))
        z += 0.9 * size
    return solids


def fountain(rng: np.random.Generator) -> list[Solid]:
    """A round basin with water and a bowl on a stem."""
    width, bowl = rng.uniform(4.0, 5.5), rng.uniform(1.4, 2.0)
    height = rng.uniform(1.5, 2.2)
    rim = (width, width, 0.8)
    solids = [part("cylinder", GENERAL, "stone", rim, (0, 0, 0.2))]
    for material, size, low, high in (
        ("water", width - 0.5, 0.5, 0.63),
        ("stone", 0.5, 0.5, height),
        ("stone", bowl, height, height + 0.25),
        ("water", bowl - 0.2, height + 0.2, height + 0.28),
    ):
        size_m = (size, size, high - low)
        solids.append(part("cylinder", GENERAL, material, size_m, (0, 0, (low + high) / 2)))
    return solids


def bollards(rng: np.random.Generator) -> list[Solid]:
    """A row of steel bollards along y."""
    count, top = int(rng.integers(3, 6)), 0.95
    ys = (np.arange(count) - (count - 1) / 2) * 1.5
    ends = [((0, y, ROOT_M), (0, y, top)) for y in ys]
    return [beam(GENERAL, colours.METAL[1], *pair, 0.22) for pair in ends]


def planter(rng: np.random.Generator) -> list[Solid]:
    """A concrete tub with a clipped shrub."""
    size = rng.uniform(1.2, 1.8)
    crown = (size + 0.1, size + 0.1, rng.uniform(0.8, 1.3))
    return [
        part("box", GENERAL, "concrete", (size, size, 0.9), (0, 0, 0.25)),
        part("ellipsoid", VEGETATION, "foliage_mid", crown, (0, 0, 0.7 + crown[2] / 2)),
    ]


def tree_planter(rng: np.random.Generator) -> list[Solid]:
    """A broad concrete tub, low enough to sit on, with a tree."""
    tub = part("box", GENERAL, "concrete", (2.4, 2.4, 0.75), (0, 0, 0.15))
    return [tub, *broadleaf(rng, max_radius_m=2.2, trunk_m=2.4)]
