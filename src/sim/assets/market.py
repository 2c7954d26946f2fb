"""What makes a market beside its stalls: a hall on posts, and strings of pennants and lights."""

from itertools import pairwise

import numpy as np

from ...ontology import BUILDING, THIN_STRUCTURE
from .. import textures as colors
from ..solid import Rng, Solid
from .furniture import wire
from .parts import Vector, beam, box, boxes, posts


def hall(rng: Rng) -> list[Solid]:
    """An open market hall along y: a tiled roof on timber posts."""
    length, run, eaves, pitch = rng.uniform(12.0, 15.0), 4.6, 3.4, 0.42
    tiles = rng.choice(["roof_tiles", "roof_slate"])
    frames = np.linspace(-0.46, 0.46, 5) * length
    solids = []
    for y in frames:
        solids.append(beam(BUILDING, colors.TIMBER, 0.2, (-3.9, y, eaves), (3.9, y, eaves)))
        solids += posts(BUILDING, colors.TIMBER, 0.26, [(-3.7, y), (3.7, y)], eaves + 0.35)

    # The roof is laid in pieces between the frames, and reaches beyond the first and the last.
    slope_m = (run / np.cos(pitch) + 0.2, length / 4, 0.18)
    for side in (-1, 1):
        for y in (frames[1:] + frames[:-1]) / 2 / 0.92:
            middle = (side * run / 2, y, eaves + run / 2 * np.tan(pitch))
            solids.append(box(BUILDING, tiles, slope_m, middle, 0.0, side * pitch))
    return solids


def bunting(rng: Rng, width_m: float) -> list[Solid]:
    """Two poles along x across a whole street, and a line of pennants or bulbs between them."""
    height, half, sag = rng.uniform(6.4, 7.4), width_m / 2, rng.uniform(0.3, 0.6)
    feet_m = [(-half, 0.0), (half, 0.0)]
    poles = posts(THIN_STRUCTURE, colors.METAL[0], 0.14, feet_m, height + 0.1)
    cable = wire((-half, 0.0, height), (half, 0.0, height), sag)
    if rng.random() >= 0.6:
        return [*poles, *cable, *_bulbs(cable)]

    joints = _joints(cable)
    paints = rng.choice(colors.SHIRTS, len(joints))
    pennants = ((p, (0.32, 0.03, 0.42), (x, y, z - 0.2)) for p, (x, y, z) in zip(paints, joints))
    return [*poles, *cable, *boxes(THIN_STRUCTURE, pennants)]


def festoon(rng: Rng, radius_m: float, spokes: int) -> list[Solid]:
    """A mast in the middle of a square, and strings of lights from it to poles all around."""
    top, low = rng.uniform(8.2, 9.0), rng.uniform(5.8, 6.4)
    metal = colors.METAL[0]
    solids = posts(THIN_STRUCTURE, metal, 0.24, [(0, 0)], top + 0.3)

    for angle in np.arange(spokes) * 2 * np.pi / spokes:
        x, y = radius_m * np.cos(angle), radius_m * np.sin(angle)
        cable = wire((0, 0, top), (x, y, low), rng.uniform(0.3, 0.6))
        solids += posts(THIN_STRUCTURE, metal, 0.14, [(x, y)], low + 0.1)
        solids += [*cable, *_bulbs(cable)]
    return solids


def _joints(cable: list[Solid]) -> list[Vector]:
    """Returns the middles of the pieces of a cable, and where they meet."""
    middles = [piece.scene_from_solid[:3, 3] for piece in cable]
    return [*middles, *((a + b) / 2 for a, b in pairwise(middles))]


def _bulbs(cable: list[Solid]) -> list[Solid]:
    rows = ((colors.HEADLIGHT, (0.14, 0.14, 0.18), (x, y, z - 0.08)) for x, y, z in _joints(cable))
    return boxes(THIN_STRUCTURE, rows)
