"""A harbour's things: bollards, boats, jetties, masts, and a road deck on columns."""

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import beam, beams, box, boxes, part, posts

# How deep a boat lies in the water, and how thick an elevated road is.
DRAUGHT_M = 0.35
DECK_M = 0.9


def bollard(rng: Rng) -> list[Solid]:
    """A mooring bollard."""
    return [
        part("cylinder", GENERAL, colors.METAL[0], (0.4, 0.4, 0.9), (0, 0, 0.25)),
        part("ellipsoid", GENERAL, colors.METAL[0], (0.55, 0.55, 0.3), (0, 0, 0.7)),
    ]


def motor_boat(rng: Rng) -> list[Solid]:
    """A cabin boat of 6 to 9 m along y, afloat on z = 0."""
    length, width = rng.uniform(6.0, 9.0), rng.uniform(2.2, 2.8)
    paint = rng.choice([colors.SIGN_WHITE, *colors.BUS_PAINT])
    freeboard = 1.2 - DRAUGHT_M
    z = freeboard - 0.6
    cabin_m, glass_m = (0.7 * width, 0.3 * length, 1.1), (0.74 * width, 0.24 * length, 0.4)

    # The bow is the front half of an elliptic cylinder as wide as the stern.
    bow_m = (width, 0.8 * length, 1.2)
    return [
        box(GENERAL, paint, (width, 0.6 * length, 1.2), (0, -0.2 * length, z)),
        part("cylinder", GENERAL, paint, bow_m, (0, 0.1 * length, z)),
        box(GENERAL, colors.SIGN_WHITE, cabin_m, (0, 0, freeboard + 0.5)),
        box(GENERAL, colors.WINDOW_GLASS, glass_m, (0, 0, freeboard + 0.7)),
    ]


def sailing_boat(rng: Rng) -> list[Solid]:
    """A yacht along y with a mast, a boom and stays."""
    length, mast = rng.uniform(7.0, 10.0), rng.uniform(9.0, 12.0)
    metal, y = colors.METAL[3], 0.1 * length
    head = (0, y, mast - 0.2)

    # Stays hold the mast from the bow, the stern and both sides.
    stays = [(head, (0, 0.47 * length, 1.0)), (head, (0, -0.47 * length, 1.0))]
    stays += [(head, (-1.2, 0, 1.1)), (head, (1.2, 0, 1.1))]
    return [
        part("ellipsoid", GENERAL, colors.SIGN_WHITE, (2.6, length, 2.0), (0, 0, 0.62)),
        box(GENERAL, "planks", (1.4, 0.35 * length, 0.6), (0, -0.05 * length, 1.6)),
        beam(THIN_STRUCTURE, metal, 0.14, (0, y, 1.2), (0, y, mast)),
        beam(THIN_STRUCTURE, metal, 0.11, (0, y, 2.6), (0, -0.35 * length, 2.6)),
        *beams(THIN_STRUCTURE, colors.CABLE, 0.035, stays),
    ]


def jetty(rng: Rng, length_m: float) -> list[Solid]:
    """A plank jetty on piles, out along -x from a quay at x = 0, given on the water's level."""
    feet_m = [(-x, y) for x in np.arange(1.0, length_m, 3.0) for y in (-0.9, 0.9)]
    return [
        box(BUILDING, "planks", (length_m, 2.0, 0.2), (-length_m / 2, 0, 0.8)),
        *posts(THIN_STRUCTURE, colors.TIMBER, 0.22, feet_m, 1.9),
    ]


def quay_crane(rng: Rng) -> list[Solid]:
    """A slewing crane on a lattice mast, its jib out along -x, over the water."""
    height, jib = rng.uniform(7.0, 9.0), rng.uniform(10.0, 13.0)
    paint = rng.choice(colors.TRUCK_PAINT[1:])
    corners_m = [(x, y) for x in (-0.7, 0.7) for y in (-0.7, 0.7)]
    braces = [
        ((x, -0.7, low), (x, 0.7, min(low + 2.0, height)))
        for x in (-0.7, 0.7)
        for low in np.arange(0.0, height - 1.0, 2.0)
    ]

    # A peak behind the cabin holds the jib by a cable; another hangs from the tip.
    tip, peak = (-jib, 0, height + 4.0), (0.6, 0, height + 3.6)
    jib_beams = []
    for y in (-0.5, 0.5):
        jib_beams.append(beam(THIN_STRUCTURE, paint, 0.16, (-0.9, y, height + 0.6), tip))
        jib_beams.append(beam(THIN_STRUCTURE, paint, 0.12, (0.6, y, height + 1.6), peak))
    return [
        *posts(THIN_STRUCTURE, paint, 0.18, corners_m, height),
        *beams(THIN_STRUCTURE, paint, 0.09, braces),
        box(GENERAL, paint, (2.0, 1.8, 1.8), (0, 0, height + 0.8)),
        box(GENERAL, colors.METAL[0], (1.6, 1.4, 1.0), (1.7, 0, height + 0.7)),
        *jib_beams,
        *beams(THIN_STRUCTURE, colors.CABLE, 0.05, ((peak, tip), (tip, (-jib, 0, 3.0)))),
        box(THIN_STRUCTURE, colors.METAL[0], (0.4, 0.3, 0.5), (-jib, 0, 2.8)),
    ]


def palm(rng: Rng) -> list[Solid]:
    """A palm of 6 to 8 m: a slim trunk and drooping fronds."""
    height = rng.uniform(6.0, 8.0)
    solids = [part("cylinder", VEGETATION, "bark", (0.3, 0.3, height + 0.2), (0, 0, height / 2))]
    turn = rng.uniform(0, 2 * np.pi)
    for angle in turn + np.linspace(0, 2 * np.pi, 8)[:-1]:
        center = (0.9 * np.cos(angle), 0.9 * np.sin(angle), height - 0.1)
        frond_m = (2.2, 0.5, 0.12)
        solids.append(part("ellipsoid", VEGETATION, "needles", frond_m, center, angle, 0.4))
    return solids


def deck(length_m: float, width_m: float) -> list[Solid]:
    """A piece of elevated road along y, its underside at z = 0: a slab, and parapets with
    railings."""
    top, half = DECK_M, length_m / 2
    rows = [
        ("concrete", (width_m, length_m, DECK_M), (0, 0, top - DECK_M / 2)),
        ("asphalt", (width_m - 1.2, length_m, 0.06), (0, 0, top + 0.03)),
    ]
    solids = boxes(BUILDING, rows)

    for side in (-1, 1):
        x = side * (width_m / 2 - 0.15)
        rails = [((x, -half, top + z), (x, half, top + z)) for z in (0.75, 1.0)]
        ys = np.arange(-half + 1.0, half, 2.0)
        rails += [((x, y, top + 0.4), (x, y, top + 1.0)) for y in ys]
        solids.append(box(BUILDING, "concrete", (0.3, length_m, 0.5), (x, 0, top + 0.25)))
        solids += beams(THIN_STRUCTURE, colors.METAL[2], 0.07, rails)
    return solids


def columns(width_m: float, under_m: float) -> list[Solid]:
    """A pair of columns under a deck, with a crossbeam along x."""
    size_m, z = (1.1, 1.1, under_m + 0.3), under_m / 2 - 0.1
    return [
        part("cylinder", BUILDING, "concrete", size_m, (-0.3 * width_m, 0, z)),
        part("cylinder", BUILDING, "concrete", size_m, (0.3 * width_m, 0, z)),
        box(BUILDING, "concrete", (0.8 * width_m, 1.2, 0.7), (0, 0, under_m - 0.3)),
    ]
