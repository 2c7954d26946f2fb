"""What makes a market beside its stalls: a hall on posts, and strings of pennants and lights."""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, THIN_STRUCTURE
from .. import textures as colours
from ..solid import Solid
from .furniture import wire
from .parts import ROOT_M, Vector, beam, part


def hall(rng: np.random.Generator) -> list[Solid]:
    """An open market hall along y: a tiled roof on timber posts."""
    length, run, eaves, pitch = rng.uniform(12.0, 15.0), 4.6, 3.4, 0.42
    tiles = str(rng.choice(["roof_tiles", "roof_slate"]))
    frames = np.linspace(-0.46, 0.46, 5) * length
    solids = []
    for y in frames:
        tie = (-3.9, y, eaves), (3.9, y, eaves)
        solids.append(beam(BUILDING, colours.TIMBER, *tie, 0.2))
        for x in (-3.7, 3.7):
            post = (x, y, ROOT_M), (x, y, eaves + 0.35)
            solids.append(beam(BUILDING, colours.TIMBER, *post, 0.26))
    slope_m = (run / np.cos(pitch) + 0.2, length / 4, 0.18)
    for side in (-1, 1):
        for y in (frames[1:] + frames[:-1]) / 2 / 0.92:
            middle = (side * run / 2, y, eaves + run / 2 * np.tan(pitch))
            solids.append(part("box", BUILDING, tiles, slope_m, middle, tilt_rad=side * pitch))
    return solids


def bunting(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Two poles along x across a whole street, and a line of pennants or bulbs between them."""
    height, half, sag = rng.uniform(6.4, 7.4), width_m / 2, rng.uniform(0.3, 0.6)
    ends = [(side * half, 0.0, height) for side in (-1, 1)]
    poles = [
        beam(THIN_STRUCTURE, colours.METAL[0], (x, y, ROOT_M), (x, y, z + 0.1), 0.14)
        for x, y, z in ends
    ]
    cable = wire(*ends, sag)
    trimming = _pennants(rng, cable) if rng.random() < 0.6 else _bulbs(cable)
    return [*poles, *cable, *trimming]


def festoon(rng: np.random.Generator, radius_m: float, spokes: int) -> list[Solid]:
    """A mast in the middle of a square, and strings of lights from it to poles all around."""
    top, low = rng.uniform(8.2, 9.0), rng.uniform(5.8, 6.4)
    mast = (0, 0, ROOT_M), (0, 0, top + 0.3)
    solids = [beam(THIN_STRUCTURE, colours.METAL[0], *mast, 0.24)]
    for angle in np.arange(spokes) * 2 * np.pi / spokes:
        x, y = radius_m * np.cos(angle), radius_m * np.sin(angle)
        pole = (x, y, ROOT_M), (x, y, low + 0.1)
        cable = wire((0, 0, top), (x, y, low), rng.uniform(0.3, 0.6))
        solids += [
            beam(THIN_STRUCTURE, colours.METAL[0], *pole, 0.14),
            *cable,
            *_bulbs(cable),
        ]
    return solids


def _joints(cable: list[Solid]) -> list[Vector]:
    """Where the pieces of a cable meet, and their middles."""
    middles = [piece.scene_from_solid[:3, 3] for piece in cable]
    return [*middles, *((a + b) / 2 for a, b in pairwise(middles))]


def _pennants(rng: np.random.Generator, cable: list[Solid]) -> list[Solid]:
    paints = rng.choice(colours.SHIRTS, len(_joints(cable)))
    return [
        part("box", THIN_STRUCTURE, str(paint), (0.32, 0.03, 0.42), (x, y, z - 0.2))
        for paint, (x, y, z) in zip(paints, _joints(cable))
    ]


def _bulbs(cable: list[Solid]) -> list[Solid]:
    return [
        part("box", THIN_STRUCTURE, colours.HEADLIGHT, (0.14, 0.14, 0.18), (x, y, z - 0.08))
        for x, y, z in _joints(cable)
    ]
