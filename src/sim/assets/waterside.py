"""A harbour's things: bollards, boats, jetties, masts, and a road deck on columns."""

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colours
from ..solid import Solid
from .parts import ROOT_M, beam, part

DRAUGHT_M = 0.35


def bollard(rng: np.random.Generator) -> list[Solid]:
    """A mooring bollard."""
    return [
        part("cylinder", GENERAL, colours.METAL[0], (0.4, 0.4, 0.9), (0, 0, 0.25)),
        part("ellipsoid", GENERAL, colours.METAL[0], (0.55, 0.55, 0.3), (0, 0, 0.7)),
    ]


def motor_boat(rng: np.random.Generator) -> list[Solid]:
    """A cabin boat of 6 to 9 m along y, afloat on z = 0."""
    length, beam_m = rng.uniform(6.0, 9.0), rng.uniform(2.2, 2.8)
    hull = str(rng.choice([colours.SIGN_WHITE, *colours.BUS_PAINT]))
    bow = (0, 0.62 * length / 2 + 0.19 * length, 0.25)
    return [
        part("box", GENERAL, hull, (beam_m, 0.62 * length, 1.2), (0, -0.19 * length / 2, 0.25)),
        part(
            "box",
            GENERAL,
            hull,
            (0.6 * beam_m, 0.38 * length, 1.2),
            (0, bow[1] - 0.1 * length, bow[2]),
        ),
        part("box", GENERAL, colours.SIGN_WHITE, (0.7 * beam_m, 0.3 * length, 1.1), (0, 0, 1.35)),
        part("box", GENERAL, colours.WINDOW_GLASS, (0.74 * beam_m, 0.2 * length, 0.4), (0, 0, 1.5)),
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


def deck(length_m: float, width_m: float, under_m: float) -> list[Solid]:
    """A piece of elevated road along y, its underside ``under_m`` above z = 0: a slab, parapets
    with railings, and lamps."""
    top = under_m + 0.9
    solids = [
        part("box", BUILDING, "concrete", (width_m, length_m, 0.9), (0, 0, under_m + 0.45)),
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
