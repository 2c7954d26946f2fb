"""A building site's and a market's things: shells, scaffolds, cranes, hoardings, bunting."""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE
from .. import textures as colours
from ..solid import Solid
from .furniture import wire
from .parts import ROOT_M, beam, part

_STOREY_M = 3.2


def shell(rng: np.random.Generator) -> list[Solid]:
    """A building without walls yet: concrete floors on columns, with starter bars on top."""
    width, depth, storeys = rng.uniform(10, 16), rng.uniform(9, 12), int(rng.integers(2, 5))
    solids = []
    for storey in range(storeys + 1):
        z = storey * _STOREY_M
        slab = (0, 0, z + 0.05 if storey else -0.05)
        solids.append(part("box", BUILDING, "concrete", (depth, width, 0.35), slab))
    ys = np.linspace(-0.45, 0.45, max(3, round(width / 4.5))) * width
    for x in (-0.43 * depth, 0.0, 0.43 * depth):
        for y in ys:
            tall = storeys * _STOREY_M
            column = part("box", BUILDING, "concrete", (0.4, 0.4, tall), (x, y, tall / 2))
            solids.append(column)
            for dx in (-0.12, 0.12):
                bar = (x + dx, y, tall), (x + dx, y, tall + 1.3)
                solids.append(beam(THIN_STRUCTURE, colours.CHIMNEY, *bar, 0.04))
    # A guard rail along the front of every open floor.
    for storey in range(1, storeys):
        z = storey * _STOREY_M + 1.0
        rail = (0.43 * depth, ys[0], z), (0.43 * depth, ys[-1], z)
        solids.append(beam(THIN_STRUCTURE, colours.BARRIER_ORANGE, *rail, 0.07))
    return solids


def scaffold(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A scaffold along y: standards, ledgers, diagonal braces and decks of planks."""
    lifts, metal = int(rng.integers(2, 5)), colours.METAL[3]
    half, top = length_m / 2, lifts * 2.0 + 1.0
    ys = np.linspace(-half, half, max(2, round(length_m / 2.5) + 1))
    solids = [
        beam(THIN_STRUCTURE, metal, (x, y, ROOT_M), (x, y, top), 0.06)
        for x in (-0.45, 0.45)
        for y in ys
    ]
    for lift in range(1, lifts + 1):
        z = 2.0 * lift
        deck = part("box", THIN_STRUCTURE, "planks", (0.9, length_m, 0.06), (0, 0, z))
        solids.append(deck)
        for rise in (0.5, 1.0):
            rail = (0.45, -half, z + rise), (0.45, half, z + rise)
            solids.append(beam(THIN_STRUCTURE, metal, *rail, 0.05))
        for low, high in pairwise(ys):
            brace = (0.45, low, z - 2.0), (0.45, high, z)
            solids.append(beam(THIN_STRUCTURE, metal, *brace, 0.05))
    return solids


def tower_crane(rng: np.random.Generator) -> list[Solid]:
    """A lattice mast with a jib above the ceiling of any flight, along y."""
    height, jib, paint = rng.uniform(22.0, 26.0), rng.uniform(16.0, 22.0), colours.BARRIER_ORANGE
    solids = [part("box", GENERAL, "concrete", (4.0, 4.0, 1.2), (0, 0, 0.4))]
    corners = [(x, y) for x in (-0.7, 0.7) for y in (-0.7, 0.7)]
    for x, y in corners:
        solids.append(beam(THIN_STRUCTURE, paint, (x, y, 0.9), (x, y, height), 0.14))
    for k, z in enumerate(np.arange(1.0, height - 2.0, 2.0)):
        side = 1 if k % 2 else -1
        for x, y, u, v in ((-0.7, -0.7, -0.7, 0.7), (0.7, 0.7, 0.7, -0.7)):
            ends = (x, side * y, z), (u, side * v, z + 2.0)
            solids.append(beam(THIN_STRUCTURE, paint, *ends, 0.08))
    cab = (0.0, 1.2, height - 0.6)
    solids.append(part("box", GENERAL, colours.SIGN_WHITE, (1.4, 1.6, 1.8), cab))
    for x in (-0.6, 0.6):
        chord = (x, -7.0, height + 0.3), (x, jib, height + 0.3)
        solids.append(beam(THIN_STRUCTURE, paint, *chord, 0.14))
    peak = (0, 0, height + 4.0)
    solids.append(beam(THIN_STRUCTURE, paint, (0, 0, height - 0.2), peak, 0.3))
    for y in (-6.5, 0.7 * jib):
        solids.append(beam(THIN_STRUCTURE, colours.CABLE, peak, (0, y, height + 0.3), 0.05))
    ballast = (0, -6.4, height - 0.4)
    solids.append(part("box", GENERAL, "concrete", (1.4, 1.4, 1.8), ballast))
    return solids


def hoarding(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A site fence along y: mesh panels in feet of concrete."""
    metal, half = colours.METAL[3], length_m / 2
    panels = max(1, round(length_m / 2.6))
    solids = []
    for y in np.linspace(-half, half, panels + 1):
        solids.append(beam(THIN_STRUCTURE, metal, (0, y, ROOT_M), (0, y, 2.0), 0.06))
        solids.append(part("box", GENERAL, colours.CONCRETE, (0.7, 0.25, 0.4), (0, y, 0.0)))
    for z in (0.25, 1.1, 1.95):
        solids.append(beam(THIN_STRUCTURE, metal, (0, -half, z), (0, half, z), 0.05))
    for y in np.arange(-half + 0.3, half, 0.4):
        solids.append(part("box", THIN_STRUCTURE, metal, (0.03, 0.03, 1.75), (0, y, 1.1)))
    return solids


def material_stack(rng: np.random.Generator) -> list[Solid]:
    """Bricks on pallets, pipes or planks."""
    kind = rng.integers(3)
    if kind == 0:
        brick = str(rng.choice(["facade_brick", "stone"]))
        return [
            part("box", GENERAL, brick, (1.1, 1.1, 1.2), (0, y, 0.45))
            for y in np.arange(int(rng.integers(1, 4))) * 1.3
        ]
    if kind == 1:
        return [
            beam(GENERAL, colours.METAL[2], (x, -2.0, z), (x, 2.0, z), 0.42)
            for x, z in ((-0.42, 0.1), (0.0, 0.1), (0.42, 0.1), (-0.21, 0.45), (0.21, 0.45))
        ]
    return [part("box", GENERAL, "planks", (1.2, 3.6, 1.0), (0, 0, 0.35))]


def bunting(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Two poles along x across a whole street, and a line of pennants or bulbs between them."""
    height, half, sag = rng.uniform(6.2, 7.2), width_m / 2, rng.uniform(0.3, 0.6)
    solids = [
        beam(
            THIN_STRUCTURE,
            colours.METAL[0],
            (s * half, 0, ROOT_M),
            (s * half, 0, height + 0.1),
            0.14,
        )
        for s in (-1, 1)
    ]
    solids += wire((-half, 0, height), (half, 0, height), sag)
    for x in np.linspace(-0.85, 0.85, max(4, round(width_m / 1.1))) * half:
        z = height - sag * (1 - (x / half) ** 2)
        paint = str(rng.choice(colours.SHIRTS))
        pennant = (x, 0, z - 0.22)
        solids.append(part("box", THIN_STRUCTURE, paint, (0.3, 0.03, 0.4), pennant))
    return solids
