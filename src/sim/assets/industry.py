"""Works and warehouses: halls, tanks, silos, pipe bridges, container stacks, masts and mesh fences.

Fronts look along +x, widths lie along y.
"""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE
from .. import textures as colors
from ..solid import Rng, Solid
from .buildings import FOUNDATION_M, block
from .parts import ROOT_M, beam, beams, box, boxes, part, posts

_CONTAINER_M = (2.4, 6.0, 2.5)
_CLADDING = ("corrugated_grey", "corrugated_blue", "corrugated_red")
_CONTAINERS = ("corrugated_red", "corrugated_blue", "corrugated_grey")


def hall(rng: Rng, width_m: float, depth_m: float) -> list[Solid]:
    """A long, low hall with roller doors, a band of windows and a saw-tooth roof of sheds."""
    eaves = rng.uniform(6.0, 9.0)
    cladding = rng.choice(_CLADDING)
    windows_m = (depth_m + 0.1, width_m - 2.0, 0.8)
    solids = [
        block(cladding, depth_m, width_m, -FOUNDATION_M, eaves),
        box(BUILDING, colors.WINDOW_GLASS, windows_m, (0, 0, eaves - 0.9)),
    ]

    # One shed of the roof and one door to each bay of some nine metres.
    bays = max(2, round(width_m / 9.0))
    bay = width_m / bays
    for k in range(bays):
        y = (k + 0.5 - bays / 2) * bay
        solids += _saw_tooth(cladding, depth_m, bay, y, eaves)
        solids.append(box(BUILDING, "roller_door", (0.16, 0.55 * bay, 4.0), (depth_m / 2, y, 1.9)))
    return solids


def _saw_tooth(
    cladding: str, depth_m: float, bay_m: float, y_m: float, eaves_m: float
) -> list[Solid]:
    """One shed of a roof: an upright row of windows, a slope, and steps that close its gables."""
    pitch = 0.28
    tall = np.tan(pitch) * bay_m
    slope_m = (bay_m / np.cos(pitch), depth_m + 0.3, 0.25)
    window = (0, y_m - bay_m / 2 + 0.15, eaves_m + tall / 2)
    rows = [
        ("roof_flat", slope_m, (0, y_m, eaves_m + tall / 2 - 0.1), np.pi / 2, pitch),
        (colors.WINDOW_GLASS, (depth_m, 0.2, tall), window),
    ]

    # Each of three steps ends where the slope comes down to its top.
    for k in range(3):
        low, high, run = k / 4 * tall, (k + 1) / 4 * tall, bay_m * (1 - (k + 1) / 4)
        middle = (0, y_m - bay_m / 2 + run / 2 + 0.1, eaves_m + (low + high) / 2 - 0.1)
        rows.append((cladding, (depth_m - 0.1, run, high - low), middle))
    return boxes(BUILDING, rows)


def tank(rng: Rng) -> list[Solid]:
    """A storage tank with a shallow roof, a ladder and a railing around its top."""
    diameter, height = rng.uniform(6.0, 10.0), rng.uniform(5.0, 9.0)
    metal, x, top = colors.METAL[1], diameter / 2 + 0.12, height + 0.9
    shell_m = (diameter, diameter, height + FOUNDATION_M)
    solids = [
        part("cylinder", BUILDING, "concrete", shell_m, (0, 0, (height - FOUNDATION_M) / 2)),
        part("cone", BUILDING, colors.METAL[3], (diameter, diameter, 1.0), (0, 0, height + 0.5)),
        *posts(THIN_STRUCTURE, metal, 0.06, [(x, -0.25), (x, 0.25)], top),
    ]
    rungs = [((x, -0.25, z), (x, 0.25, z)) for z in np.arange(0.5, height, 1.0)]
    solids += beams(THIN_STRUCTURE, metal, 0.04, rungs)

    # The railing runs just within the edge of the roof, from post to post.
    angle = np.linspace(0, 2 * np.pi, 9)
    ring_m = 0.48 * diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for corner_m, next_m in pairwise(ring_m):
        head = (*corner_m, top)
        ends = (((*corner_m, height - 0.1), head), (head, (*next_m, top)))
        solids += beams(THIN_STRUCTURE, metal, 0.06, ends)
    return solids


def silo(rng: Rng) -> list[Solid]:
    """A tall silo on a plinth, under a cone."""
    diameter, height = rng.uniform(3.2, 4.5), rng.uniform(11.0, 16.0)
    wide = (diameter, diameter)
    return [
        box(BUILDING, "concrete", (*wide, 1.4), (0, 0, 0.3)),
        part("cylinder", BUILDING, "corrugated_grey", (*wide, height), (0, 0, height / 2)),
        part("cone", BUILDING, colors.METAL[2], (*wide, 1.6), (0, 0, height + 0.8)),
    ]


def chimney(rng: Rng) -> list[Solid]:
    """A brick chimney of 22 to 30 m."""
    height = rng.uniform(22.0, 30.0)
    return [
        box(BUILDING, "concrete", (4.0, 4.0, 3.4), (0, 0, 1.3)),
        part("cylinder", BUILDING, colors.CHIMNEY, (2.4, 2.4, height), (0, 0, height / 2)),
    ]


def pipe_bridge(rng: Rng, width_m: float) -> list[Solid]:
    """Pipes on two trestles along x, across a whole street."""
    half, deck = width_m / 2, rng.uniform(6.2, 6.8)
    metal = colors.METAL[1]
    solids = []
    for x in (-half, half):
        solids += posts(THIN_STRUCTURE, metal, 0.2, [(x, -0.7), (x, 0.7)], deck)
        solids.append(beam(THIN_STRUCTURE, metal, 0.18, (x, -0.8, deck), (x, 0.8, deck)))
        brace = (x, -0.7, 0.5 * deck), (x, 0.7, 0.9 * deck)
        solids.append(beam(THIN_STRUCTURE, metal, 0.1, *brace))

    # Pipes of their own thickness lie on the trestles.
    for y, paint in zip((-0.5, 0.0, 0.5), rng.choice(colors.METAL[1:], 3)):
        thickness = rng.uniform(0.22, 0.36)
        z = deck + 0.08 + thickness / 2
        solids.append(
            beam(THIN_STRUCTURE, paint, thickness, (-half - 0.4, y, z), (half + 0.4, y, z))
        )
    return solids


def container_stack(rng: Rng) -> list[Solid]:
    """One to three freight containers on each other, along y."""
    depth, length, height = _CONTAINER_M
    rows = []
    for k in range(int(rng.integers(1, 4))):
        paint = rng.choice(_CONTAINERS)
        low, high = k * height if k else ROOT_M, (k + 1) * height
        center = (0, rng.uniform(-0.15, 0.15), (low + high) / 2)
        rows.append((paint, (depth, length, high - low), center))
    return boxes(GENERAL, rows)


def floodlight_mast(rng: Rng) -> list[Solid]:
    """A mast of 10 to 13 m with a crossbar of lamps."""
    height, metal = rng.uniform(10.0, 13.0), colors.METAL[2]
    lamps = (
        (colors.METAL[3], (0.25, 0.4, 0.35), (0.1, y, height - 0.25))
        for y in (-1.0, -0.33, 0.33, 1.0)
    )
    return [
        *posts(THIN_STRUCTURE, metal, 0.24, [(0, 0)], height),
        beam(THIN_STRUCTURE, metal, 0.12, (0, -1.2, height), (0, 1.2, height)),
        *boxes(THIN_STRUCTURE, lamps),
    ]


def mesh_fence(rng: Rng, length_m: float) -> list[Solid]:
    """A fence of 2 m along y: posts, three rails and upright wires."""
    height, metal = rng.uniform(1.9, 2.3), colors.METAL[2]
    half = length_m / 2
    ys = np.linspace(-half, half, max(2, round(length_m / 2.5) + 1))
    rails = [((0, -half, z), (0, half, z)) for z in (0.15, height / 2, height - 0.05)]

    # Boxes have fewer triangles than thin cylinders, and there are many wires.
    size_m = (0.03, 0.03, height - 0.1)
    wires = ((metal, size_m, (0, y, height / 2)) for y in np.arange(-half + 0.35, half, 0.7))
    return [
        *posts(THIN_STRUCTURE, metal, 0.09, [(0, y) for y in ys], height),
        *beams(THIN_STRUCTURE, metal, 0.05, rails),
        *boxes(THIN_STRUCTURE, wires),
    ]


def gantry_crane(rng: Rng) -> list[Solid]:
    """A portal crane over a yard: two legs, a girder along y, and a trolley with its ropes."""
    span, height = rng.uniform(11.0, 14.0), rng.uniform(8.0, 10.0)
    paint = rng.choice(colors.TRUCK_PAINT[1:])
    solids = []
    for y in (-span / 2, span / 2):
        legs = [((x, y, ROOT_M), (0.3 * x, y, height)) for x in (-1.4, 1.4)]
        solids += beams(THIN_STRUCTURE, paint, 0.3, legs)
        solids.append(beam(THIN_STRUCTURE, paint, 0.35, (-1.6, y, 0.3), (1.6, y, 0.3)))

    # The trolley may stand anywhere along the middle of the girder.
    y = rng.uniform(-0.3, 0.3) * span
    ropes = [((x, y, height - 0.5), (x, y, 3.2)) for x in (-0.3, 0.3)]
    return [
        *solids,
        box(BUILDING, paint, (0.9, span + 3.0, 0.9), (0, 0, height + 0.4)),
        box(BUILDING, colors.METAL[1], (1.4, 1.2, 0.7), (0, y, height - 0.3)),
        *beams(THIN_STRUCTURE, colors.CABLE, 0.05, ropes),
        box(THIN_STRUCTURE, colors.METAL[0], (0.9, 0.5, 0.4), (0, y, 3.1)),
    ]
