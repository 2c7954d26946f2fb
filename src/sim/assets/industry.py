"""Works and warehouses: halls, tanks, silos, pipe bridges, container stacks, masts and mesh fences.

Fronts look along +x, widths lie along y.
"""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, GENERAL, THIN_STRUCTURE
from .. import textures as colours
from ..solid import Solid
from .buildings import FOUNDATION_M
from .parts import ROOT_M, beam, part

_CONTAINER_M = (2.4, 6.0, 2.5)
_CLADDING = ("corrugated_grey", "corrugated_blue", "corrugated_red")


def hall(rng: np.random.Generator, width_m: float, depth_m: float) -> list[Solid]:
    """A long, low hall with roller doors, a band of windows and a saw-tooth roof of sheds."""
    eaves = rng.uniform(6.0, 9.0)
    cladding = str(rng.choice(_CLADDING))
    low = (0, 0, (eaves - FOUNDATION_M) / 2)
    solids = [part("box", BUILDING, cladding, (depth_m, width_m, eaves + FOUNDATION_M), low)]
    windows = (depth_m + 0.1, width_m - 2.0, 0.8)
    solids.append(part("box", BUILDING, colours.WINDOW_GLASS, windows, (0, 0, eaves - 0.9)))
    bays = max(2, round(width_m / 9.0))
    bay = width_m / bays
    for k in range(bays):
        y = (k + 0.5 - bays / 2) * bay
        solids += _saw_tooth(cladding, depth_m, bay, y, eaves)
        door = (depth_m / 2, y, 1.9)
        solids.append(part("box", BUILDING, "roller_door", (0.16, 0.55 * bay, 4.0), door))
    return solids


def _saw_tooth(
    cladding: str, depth_m: float, bay_m: float, y_m: float, eaves_m: float
) -> list[Solid]:
    """One shed of a roof: an upright row of windows, a slope, and steps that close its gables."""
    pitch = 0.28
    tall = np.tan(pitch) * bay_m
    slope = (0, y_m, eaves_m + tall / 2 - 0.1)
    size_m = (bay_m / np.cos(pitch), depth_m + 0.3, 0.25)
    window = (0, y_m - bay_m / 2 + 0.15, eaves_m + tall / 2)
    solids = [
        part("box", BUILDING, "roof_flat", size_m, slope, np.pi / 2, pitch),
        part("box", BUILDING, colours.WINDOW_GLASS, (depth_m, 0.2, tall), window),
    ]
    steps = 4
    for k in range(steps):
        # Each step ends where the slope comes down to its top.
        low, high, run = k / steps * tall, (k + 1) / steps * tall, bay_m * (1 - (k + 1) / steps)
        if run > 0:
            middle = (0, y_m - bay_m / 2 + run / 2 + 0.1, eaves_m + (low + high) / 2 - 0.1)
            size_m = (depth_m - 0.1, run, high - low)
            solids.append(part("box", BUILDING, cladding, size_m, middle))
    return solids


def tank(rng: np.random.Generator) -> list[Solid]:
    """A storage tank with a shallow roof, a ladder and a railing around its top."""
    diameter, height = rng.uniform(6.0, 10.0), rng.uniform(5.0, 9.0)
    shell = (0, 0, (height - FOUNDATION_M) / 2)
    size_m = (diameter, diameter, height + FOUNDATION_M)
    solids = [
        part("cylinder", BUILDING, "concrete", size_m, shell),
        part("cone", BUILDING, colours.METAL[3], (diameter, diameter, 1.0), (0, 0, height + 0.5)),
    ]
    metal, x = colours.METAL[1], diameter / 2 + 0.12
    for side in (-0.25, 0.25):
        ends = (x, side, ROOT_M), (x, side, height + 0.9)
        solids.append(beam(THIN_STRUCTURE, metal, *ends, 0.06))
    for z in np.arange(0.5, height, 1.0):
        solids.append(beam(THIN_STRUCTURE, metal, (x, -0.25, z), (x, 0.25, z), 0.04))
    angle = np.linspace(0, 2 * np.pi, 9)
    ring = 0.48 * diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for here, there in pairwise(ring):
        post = (*here, height - 0.1), (*here, height + 0.9)
        solids.append(beam(THIN_STRUCTURE, metal, *post, 0.06))
        rail = (*here, height + 0.9), (*there, height + 0.9)
        solids.append(beam(THIN_STRUCTURE, metal, *rail, 0.06))
    return solids


def silo(rng: np.random.Generator) -> list[Solid]:
    """A tall silo on a plinth, under a cone."""
    diameter, height = rng.uniform(3.2, 4.5), rng.uniform(11.0, 16.0)
    return [
        part("box", BUILDING, "concrete", (diameter, diameter, 1.4), (0, 0, 0.3)),
        part(
            "cylinder",
            BUILDING,
            "corrugated_grey",
            (diameter, diameter, height),
            (0, 0, height / 2),
        ),
        part("cone", BUILDING, colours.METAL[2], (diameter, diameter, 1.6), (0, 0, height + 0.8)),
    ]


def chimney(rng: np.random.Generator) -> list[Solid]:
    """A brick chimney of 22 to 30 m."""
    height = rng.uniform(22.0, 30.0)
    return [
        part("box", BUILDING, "concrete", (4.0, 4.0, 3.4), (0, 0, 1.3)),
        part("cylinder", BUILDING, colours.CHIMNEY, (2.4, 2.4, height), (0, 0, height / 2)),
    ]


def pipe_bridge(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Pipes on two trestles along x, across a whole street."""
    half, deck = width_m / 2, rng.uniform(6.2, 6.8)
    metal = colours.METAL[1]
    solids = []
    for side in (-1, 1):
        for y in (-0.7, 0.7):
            foot, head = (side * half, y, ROOT_M), (side * half, y, deck)
            solids.append(beam(THIN_STRUCTURE, metal, foot, head, 0.2))
        head = (side * half, -0.8, deck), (side * half, 0.8, deck)
        solids.append(beam(THIN_STRUCTURE, metal, *head, 0.18))
        brace = (side * half, -0.7, 0.5 * deck), (side * half, 0.7, 0.9 * deck)
        solids.append(beam(THIN_STRUCTURE, metal, *brace, 0.1))
    for y, paint in zip((-0.5, 0.0, 0.5), rng.choice(colours.METAL[1:], 3)):
        thickness = rng.uniform(0.22, 0.36)
        z = deck + 0.08 + thickness / 2
        ends = (-half - 0.4, y, z), (half + 0.4, y, z)
        solids.append(beam(THIN_STRUCTURE, str(paint), *ends, thickness))
    return solids


def container_stack(rng: np.random.Generator) -> list[Solid]:
    """One to three freight containers on each other, along y."""
    depth, length, height = _CONTAINER_M
    solids = []
    for k in range(int(rng.integers(1, 4))):
        paint = str(rng.choice(["corrugated_red", "corrugated_blue", "corrugated_grey"]))
        low = ROOT_M if k == 0 else k * height
        size_m = (depth, length, (k + 1) * height - low)
        centre = (0, rng.uniform(-0.15, 0.15), (low + (k + 1) * height) / 2)
        solids.append(part("box", GENERAL, paint, size_m, centre))
    return solids


def floodlight_mast(rng: np.random.Generator) -> list[Solid]:
    """A mast of 10 to 13 m with a crossbar of lamps."""
    height = rng.uniform(10.0, 13.0)
    solids = [
        beam(THIN_STRUCTURE, colours.METAL[2], (0, 0, ROOT_M), (0, 0, height), 0.24),
        beam(THIN_STRUCTURE, colours.METAL[2], (0, -1.2, height), (0, 1.2, height), 0.12),
    ]
    for y in (-1.0, -0.33, 0.33, 1.0):
        lamp = (0.1, y, height - 0.25)
        solids.append(part("box", THIN_STRUCTURE, colours.METAL[3], (0.25, 0.4, 0.35), lamp))
    return solids


def mesh_fence(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A fence of 2 m along y: posts, three rails and upright wires."""
    height, metal = rng.uniform(1.9, 2.3), colours.METAL[2]
    half = length_m / 2
    solids = [
        beam(THIN_STRUCTURE, metal, (0, y, ROOT_M), (0, y, height), 0.09)
        for y in np.linspace(-half, half, max(2, round(length_m / 2.5) + 1))
    ]
    for z in (0.15, height / 2, height - 0.05):
        solids.append(beam(THIN_STRUCTURE, metal, (0, -half, z), (0, half, z), 0.05))
    for y in np.arange(-half + 0.35, half, 0.7):
        wire = part("box", THIN_STRUCTURE, metal, (0.03, 0.03, height - 0.1), (0, y, height / 2))
        solids.append(wire)
    return solids


def gantry_crane(rng: np.random.Generator) -> list[Solid]:
    """A portal crane over a yard: two legs, a girder along y, and a trolley with its ropes."""
    span, height = rng.uniform(11.0, 14.0), rng.uniform(8.0, 10.0)
    paint = str(rng.choice(colours.TRUCK_PAINT[1:]))
    solids = []
    for side in (-1, 1):
        for x in (-1.4, 1.4):
            foot, head = (x, side * span / 2, ROOT_M), (0.3 * x, side * span / 2, height)
            solids.append(beam(THIN_STRUCTURE, paint, foot, head, 0.3))
        sill = (-1.6, side * span / 2, 0.3), (1.6, side * span / 2, 0.3)
        solids.append(beam(THIN_STRUCTURE, paint, *sill, 0.35))
    girder = (0, 0, height + 0.4)
    solids.append(part("box", BUILDING, paint, (0.9, span + 3.0, 0.9), girder))
    y = rng.uniform(-0.3, 0.3) * span
    solids.append(part("box", BUILDING, colours.METAL[1], (1.4, 1.2, 0.7), (0, y, height - 0.3)))
    for x in (-0.3, 0.3):
        rope = (x, y, height - 0.5), (x, y, 3.2)
        solids.append(beam(THIN_STRUCTURE, colours.CABLE, *rope, 0.05))
    solids.append(part("box", THIN_STRUCTURE, colours.METAL[0], (0.9, 0.5, 0.4), (0, y, 3.1)))
    return solids
