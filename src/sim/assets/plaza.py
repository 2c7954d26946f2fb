"""A campus: slab buildings, arcades, flag poles, sculptures, planters and bike racks."""

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colours
from ..solid import Solid
from .buildings import FOUNDATION_M
from .parts import ROOT_M, beam, part


def slab(rng: np.random.Generator, bays: int, storeys: int, facade: str) -> list[Solid]:
    """A long teaching block on a glazed ground floor, set back behind a row of columns."""
    width, depth = bays * colours.BAY_M, rng.uniform(10.0, 13.0)
    ground_floor, top = 3.6, 3.6 + storeys * colours.STOREY_M
    inner = (-0.9, 0, (ground_floor - FOUNDATION_M) / 2)
    size_m = (depth - 2.0, width - 1.0, ground_floor + FOUNDATION_M)
    upper = (0, 0, (ground_floor + top) / 2)
    solids = [
        part("box", BUILDING, "facade_glass", size_m, inner),
        part("box", BUILDING, facade, (depth, width, top - ground_floor), upper),
        part("box", BUILDING, "roof_flat", (depth + 0.3, width + 0.3, 0.4), (0, 0, top + 0.2)),
    ]
    for y in np.linspace(-0.48, 0.48, max(3, bays // 2 + 1)) * width:
        column = (depth / 2 - 0.4, y, (ground_floor + ROOT_M) / 2)
        size_m = (0.4, 0.4, ground_floor - ROOT_M)
        solids.append(part("box", BUILDING, "concrete", size_m, column))
    return solids


def arcade(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A covered walk along y: a thin roof on slim steel columns."""
    height, half = rng.uniform(3.1, 3.5), length_m / 2
    roof = part("box", BUILDING, "concrete", (3.0, length_m, 0.25), (0, 0, height))
    solids = [roof]
    for y in np.linspace(-half + 0.3, half - 0.3, max(2, round(length_m / 4.0) + 1)):
        for x in (-1.2, 1.2):
            ends = (x, y, ROOT_M), (x, y, height - 0.1)
            solids.append(beam(THIN_STRUCTURE, colours.METAL[2], *ends, 0.16))
    return solids


def flag_pole(rng: np.random.Generator) -> list[Solid]:
    """A pole of 8 to 10 m with a flag along y."""
    height, paint = rng.uniform(8.0, 10.0), str(rng.choice(colours.BUS_PAINT))
    flag = (0, 0.85, height - 0.7)
    return [
        beam(THIN_STRUCTURE, colours.METAL[3], (0, 0, ROOT_M), (0, 0, height), 0.12),
        part("box", THIN_STRUCTURE, paint, (0.05, 1.6, 1.0), flag),
    ]


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


def planter(rng: np.random.Generator) -> list[Solid]:
    """A concrete tub with a clipped shrub."""
    size = rng.uniform(1.2, 1.8)
    crown = (size + 0.1, size + 0.1, rng.uniform(0.8, 1.3))
    return [
        part("box", GENERAL, "concrete", (size, size, 0.9), (0, 0, 0.25)),
        part("ellipsoid", VEGETATION, "foliage_mid", crown, (0, 0, 0.7 + crown[2] / 2)),
    ]


def bike_rack(rng: np.random.Generator) -> list[Solid]:
    """A row of hoops along y."""
    solids = []
    for y in np.arange(int(rng.integers(4, 8))) * 0.8:
        for x in (-0.35, 0.35):
            leg = (x, y, ROOT_M), (x, y, 0.8)
            solids.append(beam(THIN_STRUCTURE, colours.METAL[2], *leg, 0.06))
        top = (-0.38, y, 0.8), (0.38, y, 0.8)
        solids.append(beam(THIN_STRUCTURE, colours.METAL[2], *top, 0.06))
    return solids


def banner_line(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Two masts along x across a walk, a cable between them, and a banner that hangs from it."""
    height, half = rng.uniform(7.0, 7.6), width_m / 2
    paint = str(rng.choice(colours.BUS_PAINT))
    solids = [
        beam(
            THIN_STRUCTURE,
            colours.METAL[2],
            (s * half, 0, ROOT_M),
            (s * half, 0, height + 0.2),
            0.16,
        )
        for s in (-1, 1)
    ]
    for drop in (0.0, 1.1):
        ends = (-half, 0, height - drop), (half, 0, height - drop)
        solids.append(beam(THIN_STRUCTURE, colours.CABLE, *ends, 0.04))
    banner = (0, 0, height - 0.55)
    return [*solids, part("box", THIN_STRUCTURE, paint, (0.5 * width_m, 0.04, 1.1), banner)]
