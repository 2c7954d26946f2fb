"""What stands on a building site: shells, scaffolds, a tower crane, site fences and supplies.

Fronts look along +x, as everywhere beside a street.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import Ends, beams, box, boxes, part, posts

# From floor to floor of a shell, and from deck to deck of a scaffold.
STOREY_M = 3.2
LIFT_M = 2.0
SCAFFOLD_DEPTH_M = 0.9

# ---------------------------------------------------------------------------------- buildings


def shell(rng: Rng) -> list[Solid]:
    """A building without walls yet: concrete floors on columns, guard rails along the open floors,
    and starter bars on top."""
    width, depth, storeys = rng.uniform(10, 16), rng.uniform(9, 12), int(rng.integers(2, 5))
    xs = np.array([-0.43, 0.0, 0.43]) * depth
    ys = np.linspace(-0.45, 0.45, max(3, round(width / 4.5))) * width
    top = storeys * STOREY_M
    floors_m = np.arange(1, storeys + 1) * STOREY_M
    solids = [box(BUILDING, "concrete", (depth, width, 0.7), (0, 0, -0.05))]
    solids += boxes(BUILDING, (("concrete", (depth, width, 0.35), (0, 0, z)) for z in floors_m))

    # Bars of steel stand out of the columns, where the next storey would begin.
    for x, y in ((x, y) for x in xs for y in ys):
        bars = [((x + dx, y, top), (x + dx, y, top + 1.3)) for dx in (-0.12, 0.12)]
        solids.append(box(BUILDING, "concrete", (0.4, 0.4, top), (x, y, top / 2)))
        solids += beams(THIN_STRUCTURE, colors.CHIMNEY, 0.04, bars)

    # Two guard rails around each open floor, from corner to corner.
    for floor_m in floors_m[:-1]:
        rails: list[Ends] = []
        for z in (floor_m + 0.7, floor_m + 1.2):
            rails += [((x, ys[0], z), (x, ys[-1], z)) for x in xs[[0, -1]]]
            rails += [((xs[0], y, z), (xs[-1], y, z)) for y in ys[[0, -1]]]
        solids += beams(THIN_STRUCTURE, colors.BARRIER_ORANGE, 0.07, rails)
    return solids


def scaffold(length_m: float, lifts: int) -> list[Solid]:
    """A scaffold along y: standards, rails, diagonal braces, and a deck of planks at every lift."""
    half, top = length_m / 2, lifts * LIFT_M + 1.1
    inner, outer = -SCAFFOLD_DEPTH_M / 2, SCAFFOLD_DEPTH_M / 2
    ys = np.linspace(-half, half, max(2, round(length_m / 2.5) + 1))

    # Rails and braces are on the outer side alone: the inner one faces the wall.
    ledgers: list[Ends] = []
    decks = []
    for z in np.arange(1, lifts + 1) * LIFT_M:
        decks.append(("planks", (SCAFFOLD_DEPTH_M, length_m, 0.06), (0, 0, z)))
        ledgers += [((outer, -half, z + up), (outer, half, z + up)) for up in (0.5, 1.0)]
        ledgers += [((outer, a, z - LIFT_M), (outer, b, z)) for a, b in list(pairwise(ys))[::2]]

    feet_m = [(x, y) for x in (inner, outer) for y in ys]
    return [
        *boxes(THIN_STRUCTURE, decks),
        *posts(THIN_STRUCTURE, colors.METAL[3], 0.06, feet_m, top),
        *beams(THIN_STRUCTURE, colors.METAL[3], 0.05, ledgers),
    ]


# -------------------------------------------------------------------------------------- crane


def tower_crane(rng: Rng) -> list[Solid]:
    """A lattice mast of 22 to 26 m and, above the ceiling of any flight, a jib along y."""
    height, jib, back = rng.uniform(22.0, 26.0), rng.uniform(16.0, 22.0), 7.0
    paint = rng.choice([colors.BARRIER_ORANGE, colors.BUS_PAINT[2]])
    mast = _girder(height - 0.6, 0.7) + np.array([0, 0, 0.6])
    # The jib is a girder laid down along y; it reaches back to hold the counterweight.
    arm = _girder(jib + back, 0.5)[..., [0, 2, 1]] + np.array([0, -back, height + 0.5])

    peak = np.array([0, 0, height + 4.5])
    stays = [(peak, (0, y, height + 1.0)) for y in (-back + 0.5, 0.4 * jib, 0.85 * jib)]
    hook = (0, 0.7 * jib, height - rng.uniform(1.0, 2.5))
    return [
        box(GENERAL, "concrete", (4.0, 4.0, 1.2), (0, 0, 0.1)),
        *beams(THIN_STRUCTURE, paint, 0.12, [*mast, *arm, ((0, 0, height), peak)]),
        *beams(THIN_STRUCTURE, colors.CABLE, 0.05, [*stays, ((0, 0.7 * jib, height + 0.1), hook)]),
        box(GENERAL, colors.SIGN_WHITE, (1.3, 1.5, 1.8), (1.3, 0.6, height - 0.9)),
        box(GENERAL, "concrete", (1.2, 1.6, 1.6), (0, 1.0 - back, height - 0.6)),
    ]


def _girder(length_m: float, half_m: float) -> Float[np.ndarray, "n 2 3"]:
    """Ends of the chords and diagonals of a square lattice girder along z, from z = 0."""
    corners = half_m * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    ends = [((*corner, 0.0), (*corner, length_m)) for corner in corners]

    # The diagonals of a bay of some 2.2 m lean the other way than those of the bay below.
    levels = np.linspace(0, length_m, round(length_m / 2.2) + 1)
    for k, (low, high) in enumerate(pairwise(levels)):
        for corner, other in zip(corners, np.roll(corners, -1, axis=0)):
            near, far = (corner, other) if k % 2 else (other, corner)
            ends.append(((*near, low), (*far, high)))
    return np.array(ends)


# --------------------------------------------------------------------------- fences, supplies


def site_fence(rng: Rng, length_m: float) -> list[Solid]:
    """A fence along y, 2 m tall: panels of welded bars that stand in concrete feet."""
    metal, half = colors.METAL[3], length_m / 2
    ys = np.linspace(-half, half, max(1, round(length_m / 2.6)) + 1)
    bars = [y for a, b in pairwise(ys) for y in np.linspace(a, b, 6)[1:-1]]
    rails = [((0, -half, z), (0, half, z)) for z in (0.25, 1.95)]

    return [
        *boxes(GENERAL, (("concrete", (0.7, 0.25, 0.4), (0, y, 0.0)) for y in ys)),
        *posts(THIN_STRUCTURE, metal, 0.06, [(0, y) for y in ys], 2.0),
        *beams(THIN_STRUCTURE, metal, 0.05, rails),
        *boxes(THIN_STRUCTURE, ((metal, (0.03, 0.03, 1.7), (0, y, 1.1)) for y in bars)),
    ]


def supplies(rng: Rng) -> list[Solid]:
    """Bricks on pallets, a heap of pipes, or a stack of boards."""
    kind = rng.integers(3)
    if kind == 0:
        stacks = np.arange(int(rng.integers(1, 4))) * 1.3
        return boxes(GENERAL, (("bricks", (1.1, 1.1, 1.2), (0, y, 0.45)) for y in stacks))

    if kind == 1:
        places = ((-0.42, 0.1), (0.0, 0.1), (0.42, 0.1), (-0.21, 0.46), (0.21, 0.46), (0.0, 0.82))
        half = rng.uniform(1.6, 2.4)
        ends = [((x, -half, z), (x, half, z)) for x, z in places]
        return beams(GENERAL, colors.METAL[2], 0.42, ends)

    return [box(GENERAL, "planks", (1.2, rng.uniform(2.6, 4.0), 1.0), (0, 0, 0.35))]


def skip(rng: Rng) -> list[Solid]:
    """An open steel skip along y, filled with rubble."""
    paint, length = rng.choice(colors.TRUCK_PAINT[1:]), rng.uniform(2.8, 3.6)
    walls = [(paint, (1.7, length, 0.5), (0, 0, 0.05))]
    for side in (-1, 1):
        walls.append((paint, (0.1, length, 1.0), (side * 0.8, 0, 0.75)))
        walls.append((paint, (1.6, 0.1, 0.8), (0, side * (length / 2 - 0.05), 0.65)))

    rubble = (1.5, length - 0.2, rng.uniform(1.4, 2.0))
    return [*boxes(GENERAL, walls), part("ellipsoid", GENERAL, "gravel", rubble, (0, 0, 0.6))]
