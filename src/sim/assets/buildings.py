"""Buildings: boxes with textured facades, roofs, setbacks, balconies, awnings and chimneys.

The front looks along +x, the width lies along y, and the origin is the middle of the footprint.
Widths and heights are whole bays and storeys of the facade textures, so that no window is cut.
"""

import numpy as np

from ...ontology import BUILDING
from .. import textures
from ..solid import Solid
from .parts import part

FOUNDATION_M = 0.4
"""How far a building reaches into the ground."""

_SHOPS = ("shopfront_red", "shopfront_blue", "shopfront_green")
_SHOP_M = 4.0


def _block(
    material: str, depth_m: float, width_m: float, low_m: float, high_m: float, x_m: float = 0.0
) -> Solid:
    size_m = (depth_m, width_m, high_m - low_m)
    return part("box", BUILDING, material, size_m, (x_m, 0, (low_m + high_m) / 2))


def _plinth(depth_m: float, width_m: float) -> Solid:
    return _block("stone", depth_m + 0.1, width_m + 0.1, -FOUNDATION_M, 0.35)


def tower(
    rng: np.random.Generator, bays: int, depth_m: float, storeys: int, facade: str
) -> list[Solid]:
    """A city block over shops, with a cornice, and a narrower top where it is tall."""
    width = bays * textures.BAY_M
    lower = storeys if storeys < 8 else storeys - int(rng.integers(2, 5))
    shoulder = _SHOP_M + lower * textures.STOREY_M
    shop = str(rng.choice(_SHOPS))
    solids = [
        _plinth(depth_m, width),
        _block(shop, depth_m, width, 0.0, _SHOP_M),
        _block(facade, depth_m, width, _SHOP_M, shoulder),
        _block("roof_flat", depth_m + 0.5, width + 0.5, shoulder, shoulder + 0.5),
        _block("stone", depth_m + 0.4, width + 0.4, _SHOP_M - 0.25, _SHOP_M + 0.15),
    ]
    if lower < storeys:
        roof = shoulder + (storeys - lower) * textures.STOREY_M
        solids.append(_block(facade, depth_m - 4, width - 6, shoulder, roof))
        solids.append(_block("roof_flat", depth_m - 3.6, width - 5.6, roof, roof + 0.4))
    else:
        centre = (0, rng.uniform(-0.25, 0.25) * width, shoulder + 1.2)
        solids.append(part("box", BUILDING, "roof_flat", (3, 3, 2), centre))
    return solids + _awnings(rng, depth_m / 2, bays)


def _awnings(rng: np.random.Generator, front_m: float, bays: int) -> list[Solid]:
    """Sloping awnings over some of the shops."""
    material = str(rng.choice(["awning_red", "awning_green"]))
    return [
        part(
            "box",
            BUILDING,
            material,
            (1.3, 2.6, 0.08),
            (front_m + 0.55, (bay + 0.5 - bays / 2) * textures.BAY_M, 2.9),
            tilt_rad=0.3,
        )
        for bay in range(bays)
        if rng.random() < 0.4
    ]


def apartment(
    rng: np.random.Generator, bays: int, depth_m: float, storeys: int, facade: str
) -> list[Solid]:
    """A house of flats with balconies on its front and a flat roof."""
    width, top = bays * textures.BAY_M, storeys * textures.STOREY_M
    solids = [
        _plinth(depth_m, width),
        _block(facade, depth_m, width, 0.0, top),
        _block("roof_flat", depth_m + 0.4, width + 0.4, top, top + 0.4),
    ]
    for bay in range(int(rng.integers(2)), bays, 2):
        y = (bay + 0.5 - bays / 2) * textures.BAY_M
        for storey in range(1, storeys):
            floor = storey * textures.STOREY_M
            slab = (depth_m / 2 + 0.5, y, floor)
            solids.append(part("box", BUILDING, textures.CONCRETE, (1.1, 2.4, 0.15), slab))
            rail = (depth_m / 2 + 1.0, y, floor + 0.55)
            solids.append(part("box", BUILDING, textures.METAL[1], (0.08, 2.4, 0.9), rail))
    return solids


def gabled_house(
    rng: np.random.Generator, bays: int, depth_m: float, storeys: int, facade: str
) -> list[Solid]:
    """A house under a pitched roof, its ridge along the street, with a chimney and a door."""
    width, eaves = bays * textures.BAY_M, storeys * textures.STOREY_M
    tiles = str(rng.choice(["roof_tiles", "roof_slate"]))
    pitch = rng.uniform(0.5, 0.7)
    run = depth_m / 2 + 0.4
    ridge = eaves + np.tan(pitch) * depth_m / 2
    solids = [_plinth(depth_m, width), _block(facade, depth_m, width, 0.0, eaves)]
    steps = 3
    for k in range(steps):
        low, high = (eaves + (ridge - eaves) * f for f in (k / steps, (k + 1) / steps))
        gable = depth_m * (1 - (k + 1) / steps) + 0.3
        solids.append(_block("siding_white", gable, width - 0.2, low, high - 0.05))
    for side in (-1, 1):
        middle = (side * run / 2, 0, (ridge + eaves - 0.4 * np.tan(pitch)) / 2 + 0.1)
        size_m = (run / np.cos(pitch) + 0.1, width + 0.6, 0.2)
        solids.append(part("box", BUILDING, tiles, size_m, middle, tilt_rad=side * pitch))
    chimney = (-0.2 * depth_m, 0.3 * width, ridge)
    solids.append(part("box", BUILDING, textures.CHIMNEY, (0.7, 0.7, 2.0), chimney))
    door = (depth_m / 2, rng.choice([-1, 1]) * textures.BAY_M / 2 * (bays % 2 == 0), 1.05)
    solids.append(part("box", BUILDING, textures.TIMBER, (0.16, 1.0, 2.1), door))
    return solids


def shed(rng: np.random.Generator) -> list[Solid]:
    """A garden shed or garage with a lean-to roof."""
    depth, width, height = rng.uniform(2.5, 5.0), rng.uniform(2.5, 3.5), rng.uniform(2.1, 2.5)
    roof = part(
        "box",
        BUILDING,
        "roof_slate",
        (depth + 0.5, width + 0.5, 0.12),
        (0, 0, height + 0.12),
        tilt_rad=0.12,
    )
    return [_block("planks", depth, width, -0.2, height), roof]


def kiosk(rng: np.random.Generator) -> list[Solid]:
    """A small pavilion with an awning."""
    material = str(rng.choice(["siding_blue", "siding_white", "planks"]))
    solids = [
        _block(material, 2.6, 3.6, -0.2, 2.6),
        _block("roof_flat", 3.4, 4.4, 2.6, 2.85),
    ]
    stripes = str(rng.choice(["awning_red", "awning_green"]))
    awning = part("box", BUILDING, stripes, (1.4, 3.4, 0.08), (1.9, 0, 2.35), tilt_rad=0.25)
    return [*solids, awning]
