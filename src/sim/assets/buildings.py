"""Buildings: boxes with textured facades, roofs, setbacks, balconies, awnings and chimneys.

The front looks along +x, the width lies along y, and the origin is the middle of the footprint.
Widths and heights are whole bays and storeys of the facade textures, so that no window is cut.
"""

import numpy as np

from ...ontology import BUILDING
from ..solid import Rng, Solid
from ..textures import BAY_M, CHIMNEY, CONCRETE, METAL, STOREY_M, TIMBER
from .parts import box, boxes

# How far a building reaches into the ground.
FOUNDATION_M = 0.4

_SHOPS = ("shopfront_red", "shopfront_blue", "shopfront_green")
_SHOP_M = 4.0
_AWNINGS = ("awning_red", "awning_green")


def block(material: str, depth_m: float, width_m: float, low_m: float, high_m: float) -> Solid:
    """A box over the origin between two heights."""
    center_m = (0, 0, (low_m + high_m) / 2)
    return box(BUILDING, material, (depth_m, width_m, high_m - low_m), center_m)


def _plinth(depth_m: float, width_m: float) -> Solid:
    return block("stone", depth_m + 0.1, width_m + 0.1, -FOUNDATION_M, 0.35)


def tower(rng: Rng, bays: int, depth_m: float, storeys: int, facade: str) -> list[Solid]:
    """A city block over shops, with a cornice, and a narrower top where it is tall."""
    width = bays * BAY_M
    lower = storeys if storeys < 8 else storeys - int(rng.integers(2, 5))
    shoulder = _SHOP_M + lower * STOREY_M
    shop = rng.choice(_SHOPS)
    solids = [
        _plinth(depth_m, width),
        block(shop, depth_m, width, 0.0, _SHOP_M),
        block(facade, depth_m, width, _SHOP_M, shoulder),
        block("roof_flat", depth_m + 0.5, width + 0.5, shoulder, shoulder + 0.5),
        block("stone", depth_m + 0.4, width + 0.4, _SHOP_M - 0.25, _SHOP_M + 0.15),
    ]

    # A tall block ends in a set-back top, a low one in a machine room on its roof.
    if lower < storeys:
        roof = shoulder + (storeys - lower) * STOREY_M
        solids.append(block(facade, depth_m - 4, width - 6, shoulder, roof))
        solids.append(block("roof_flat", depth_m - 3.6, width - 5.6, roof, roof + 0.4))
    else:
        center = (0, rng.uniform(-0.25, 0.25) * width, shoulder + 1.2)
        solids.append(box(BUILDING, "roof_flat", (3, 3, 2), center))

    # Sloping awnings over some of the shops.
    awning = rng.choice(_AWNINGS)
    for bay in range(bays):
        if rng.random() < 0.4:
            center = (depth_m / 2 + 0.55, (bay + 0.5 - bays / 2) * BAY_M, 2.9)
            solids.append(box(BUILDING, awning, (1.3, 2.6, 0.08), center, 0.0, 0.3))
    return solids


def apartment(rng: Rng, bays: int, depth_m: float, storeys: int, facade: str) -> list[Solid]:
    """A house of flats with balconies on its front and a flat roof."""
    width, top = bays * BAY_M, storeys * STOREY_M
    solids = [
        _plinth(depth_m, width),
        block(facade, depth_m, width, 0.0, top),
        block("roof_flat", depth_m + 0.4, width + 0.4, top, top + 0.4),
    ]

    # Every other bay has a balcony on each storey but the lowest.
    for bay in range(int(rng.integers(2)), bays, 2):
        y = (bay + 0.5 - bays / 2) * BAY_M
        for floor in np.arange(1, storeys) * STOREY_M:
            balcony = (
                (CONCRETE, (1.1, 2.4, 0.15), (depth_m / 2 + 0.5, y, floor)),
                (METAL[1], (0.08, 2.4, 0.9), (depth_m / 2 + 1.0, y, floor + 0.55)),
            )
            solids += boxes(BUILDING, balcony)
    return solids


def gabled_house(rng: Rng, bays: int, depth_m: float, storeys: int, facade: str) -> list[Solid]:
    """A house under a pitched roof, its ridge along the street, with a chimney and a door."""
    width, eaves = bays * BAY_M, storeys * STOREY_M
    tiles = rng.choice(["roof_tiles", "roof_slate"])
    pitch = rng.uniform(0.5, 0.7)
    run = depth_m / 2 + 0.4
    ridge = eaves + np.tan(pitch) * depth_m / 2
    solids = [_plinth(depth_m, width), block(facade, depth_m, width, 0.0, eaves)]

    # There is no prism among the shapes, so three steps close each gable under the roof.
    for k in range(3):
        low, high = (eaves + (ridge - eaves) * share for share in (k / 3, (k + 1) / 3))
        gable = depth_m * (1 - (k + 1) / 3) + 0.3
        solids.append(block("siding_white", gable, width - 0.2, low, high - 0.05))
    size_m = (run / np.cos(pitch) + 0.1, width + 0.6, 0.2)
    for side in (-1, 1):
        middle = (side * run / 2, 0, (ridge + eaves - 0.4 * np.tan(pitch)) / 2 + 0.1)
        solids.append(box(BUILDING, tiles, size_m, middle, 0.0, side * pitch))

    # The door stands in the middle of a bay: beside the front's middle where bays are even.
    side = rng.choice([-1, 1])
    door_y = side * BAY_M / 2 if bays % 2 == 0 else 0.0
    return [
        *solids,
        box(BUILDING, CHIMNEY, (0.7, 0.7, 2.0), (-0.2 * depth_m, 0.3 * width, ridge)),
        box(BUILDING, TIMBER, (0.16, 1.0, 2.1), (depth_m / 2, door_y, 1.05)),
    ]


def shed(rng: Rng) -> list[Solid]:
    """A garden shed or garage with a lean-to roof."""
    depth, width, height = rng.uniform(2.5, 5.0), rng.uniform(2.5, 3.5), rng.uniform(2.1, 2.5)
    size_m = (depth + 0.5, width + 0.5, 0.12)
    roof = box(BUILDING, "roof_slate", size_m, (0, 0, height + 0.12), 0.0, 0.12)
    return [block("planks", depth, width, -0.2, height), roof]


def kiosk(rng: Rng) -> list[Solid]:
    """A small pavilion with an awning."""
    material = rng.choice(["siding_blue", "siding_white", "planks"])
    awning = rng.choice(_AWNINGS)
    return [
        block(material, 2.6, 3.6, -0.2, 2.6),
        block("roof_flat", 3.4, 4.4, 2.6, 2.85),
        box(BUILDING, awning, (1.4, 3.4, 0.08), (1.9, 0, 2.35), 0.0, 0.25),
    ]
