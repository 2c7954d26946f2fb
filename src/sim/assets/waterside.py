"""A harbour's things: bollards, boats, jetties, masts, and a road deck on columns."""

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colours
from ..solid import Solid
from .parts import ROOT_M, beam, part

DRAUGHT_M = 0.35
DECK_M = 0.9
"""Thickness of an elevated road."""


def bollard(rng: np.random.Generator) -> list[Solid]:
    """A mooring bollard."""
    return [
        part("cylinder", GENERAL, colours.METAL[0], (0.4, 0.4, 0.9), (0, 0, 0.25)),
        part("ellipsoid", GENERAL, colours.METAL[0], (0.55, 0.55, 0.3), (0, 0, 0.7)),
    ]


def motor_boat(rng: np.random.Generator) -> list[Solid]:
    """A cabin boat of 6 to 9 m along y, afloat on z = 0."""
    length, width = rng.uniform(6.0, 9.0), rng.uniform(2.2, 2.8)
    paint = str(rng.choice([colours.SIGN_WHITE, *colours.BUS_PAINT]))
    freeboard, stern = 1.2 - DRAUGHT_M, 0.6 * length
    # The bow is the front half of an elliptic cylinder as wide as the stern.
    bow = (width, 0.8 * length, 1.2)
    ahead = 0.1 * length
    cabin, glass = (0.7 * width, 0.3 * length, 1.1), (0.74 * width, 0.24 * length, 0.4)
    return [
        part("box", GENERAL, paint, (width, stern, 1.2), (0, -0.2 * length, freeboard - 0.6)),
        part("cylinder", GENERAL, paint, bow, (0, ahead, freeboard - 0.6)),
        part("box", GENERAL, colours.SIGN_WHITE, cabin, (0, 0, freeboard + 0.5)),
        part("box", GENERAL, colours.WINDOW_GLASS, glass, (0, 0, freeboard + 0.7)),
    ]


def sailing_boat(rng: np.random.Generator) -> list[Solid]:
    """A yacht along y with a mast, a boom and stays."""
    length, mast = rng.uniform(7.0, 10.0), rng.uniform(9.0, 12.0)
    metal = colours.METAL[3]
    hull = part("ellipsoid", GENERAL, colours.SIGN_WHITE, (2.6, length, 2.0), (0, 0, 0.62))
    cabin = part("box", GENERAL, "planks", (1.4, 0.35 * length, 0.6), (0, -0.05 * length, 1.6))
    solids = [hull, cabin]
    solids.append(
        beam(THIN_STRUCTURE, metal, (0, 0.1 * length, 1.2), (0, 0.1 * length, mast), 0.14)
    )
    boom = (0, 0.1 * length, 2.6), (0, -0.35 * length, 2.6)
    solids.append(beam(THIN_STRUCTURE, metal, *boom, 0.11))
    for end in ((0, 0.47 * length, 1.0), (0, -0.47 * length, 1.0), (-1.2, 0, 1.1), (1.2, 0, 1.1)):
        stay = (0, 0.1 * length, mast - 0.2), end
        solids.append(beam(THIN_STRUCTURE, colours.CABLE, *stay, 0.035))
    return solids


def jetty(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A plank jetty on piles, out along -x from a quay at x = 0, given on the water's level."""
    solids = [part("box", BUILDING, "planks", (length_m, 2.0, 0.2), (-length_m / 2, 0, 0.8))]
    for x in np.arange(1.0, length_m, 3.0):
        for y in (-0.9, 0.9):
            pile = (-x, y, ROOT_M), (-x, y, 1.9)
            solids.append(beam(THIN_STRUCTURE, colours.TIMBER, *pile, 0.22))
    return solids


def quay_crane(rng: np.random.Generator) -> list[Solid]:
    """A slewing crane on a lattice mast, its jib out along -x, over the water."""
    height, jib = rng.uniform(7.0, 9.0), rng.uniform(10.0, 13.0)
    paint = str(rng.choice(colours.TRUCK_PAINT[1:]))
    corners = [(x, y) for x in (-0.7, 0.7) for y in (-0.7, 0.7)]
    solids = [beam(THIN_STRUCTURE, paint, (x, y, ROOT_M), (x, y, height), 0.18) for x, y in corners]
    for x in (-0.7, 0.7):
        for low in np.arange(0.0, height - 1.0, 2.0):
            brace = (x, -0.7, low), (x, 0.7, min(low + 2.0, height))
            solids.append(beam(THIN_STRUCTURE, paint, *brace, 0.09))
    cabin, ballast = (0, 0, height + 0.8), (1.7, 0, height + 0.7)
    solids.append(part("box", GENERAL, paint, (2.0, 1.8, 1.8), cabin))
    solids.append(part("box", GENERAL, colours.METAL[0], (1.6, 1.4, 1.0), ballast))
    tip, peak = (-jib, 0, height + 4.0), (0.6, 0, height + 3.6)
    for side in (-0.5, 0.5):
        foot = (-0.9, side, height + 0.6)
        solids.append(beam(THIN_STRUCTURE, paint, foot, tip, 0.16))
        solids.append(beam(THIN_STRUCTURE, paint, (0.6, side, height + 1.6), peak, 0.12))
    solids.append(beam(THIN_STRUCTURE, colours.CABLE, peak, tip, 0.05))
    solids.append(beam(THIN_STRUCTURE, colours.CABLE, tip, (-jib, 0, 3.0), 0.05))
    hook = (-jib, 0, 2.8)
    solids.append(part("box", THIN_STRUCTURE, colours.METAL[0], (0.4, 0.3, 0.5), hook))
    return solids


def palm(rng: np.random.Generator) -> list[Solid]:
    """A palm of 6 to 8 m: a slim trunk and drooping fronds."""
    height = rng.uniform(6.0, 8.0)
    trunk = part("cylinder", VEGETATION, "bark", (0.3, 0.3, height + 0.2), (0, 0, height / 2))
    solids = [trunk]
    turn = rng.uniform(0, 2 * np.pi)
    for angle in turn + np.linspace(0, 2 * np.pi, 8)[:-1]:
        size_m, out = (2.2, 0.5, 0.12), 0.9
        centre = (out * np.cos(angle), out * np.sin(angle), height - 0.1)
        solids.append(part("ellipsoid", VEGETATION, "needles", size_m, centre, angle, 0.4))
    return solids


def deck(length_m: float, width_m: float) -> list[Solid]:
    """A piece of elevated road along y, its underside at z = 0: a slab, and parapets with
    railings."""
    top = DECK_M
    solids = [
        part("box", BUILDING, "concrete", (width_m, length_m, DECK_M), (0, 0, top - DECK_M / 2)),
        part("box", BUILDING, "asphalt", (width_m - 1.2, length_m, 0.06), (0, 0, top + 0.03)),
    ]
    for side in (-1, 1):
        x = side * (width_m / 2 - 0.15)
        solids.append(part("box", BUILDING, "concrete", (0.3, length_m, 0.5), (x, 0, top + 0.25)))
        for z in (0.75, 1.0):
            rail = (x, -length_m / 2, top + z), (x, length_m / 2, top + z)
            solids.append(beam(THIN_STRUCTURE, colours.METAL[2], *rail, 0.07))
        for y in np.arange(-length_m / 2 + 1.0, length_m / 2, 2.0):
            post = (x, y, top + 0.4), (x, y, top + 1.0)
            solids.append(beam(THIN_STRUCTURE, colours.METAL[2], *post, 0.07))
    return solids


def columns(width_m: float, under_m: float) -> list[Solid]:
    """A pair of columns under a deck, with a crossbeam along x."""
    solids = [
        part("cylinder", BUILDING, "concrete", (1.1, 1.1, under_m + 0.3), (x, 0, under_m / 2 - 0.1))
        for x in (-0.3 * width_m, 0.3 * width_m)
    ]
    crossbeam = (0, 0, under_m - 0.3)
    return [*solids, part("box", BUILDING, "concrete", (0.8 * width_m, 1.2, 0.7), crossbeam)]
