"""Trees, bushes and hedges. Bare branches are thin structures, as the ontology has it."""

import numpy as np

from ...ontology import THIN_STRUCTURE, VEGETATION
from ..solid import Rng, Solid
from .parts import ROOT_M, beam, box, part

# Leaves and how common each is: most are dark or mid green, one tree in twenty is in autumn.
_CROWNS = ("foliage_dark", "foliage_mid", "foliage_light", "foliage_autumn")
_CROWN_SHARES = (0.35, 0.4, 0.2, 0.05)


def _trunk(diameter_m: float, top_m: float) -> Solid:
    size_m = (diameter_m, diameter_m, top_m - ROOT_M)
    return part("cylinder", VEGETATION, "bark", size_m, (0, 0, (top_m + ROOT_M) / 2))


def broadleaf(rng: Rng, max_radius_m: float = 3.5, trunk_m: float = 2.2) -> list[Solid]:
    """A tree of 5 to 12 m: a clear trunk, and a crown of several lobes within ``max_radius_m``."""
    radius = rng.uniform(0.65, 1.0) * max_radius_m
    clear = trunk_m + rng.uniform(0.0, 1.0)
    crown_height = rng.uniform(1.5, 2.2) * radius
    middle = clear + crown_height / 2
    foliage = rng.choice(_CROWNS, p=_CROWN_SHARES)
    core = (1.5 * radius, 1.5 * radius, crown_height)
    solids = [
        _trunk(rng.uniform(0.25, 0.4), middle),
        part("ellipsoid", VEGETATION, foliage, core, (0, 0, middle)),
    ]

    # Four lobes around the core, or the crown would be a plain egg.
    start = rng.uniform(0, 2 * np.pi)
    for angle in start + np.arange(4) * np.pi / 2 + rng.uniform(-0.3, 0.3, 4):
        lobe = rng.uniform(0.9, 1.1) * radius
        reach = radius - lobe / 2
        height = middle + rng.uniform(-0.2, 0.25) * crown_height
        center = (reach * np.cos(angle), reach * np.sin(angle), height)
        solids.append(part("ellipsoid", VEGETATION, foliage, (lobe, lobe, 0.8 * lobe), center))
    return solids


def street_tree(rng: Rng) -> list[Solid]:
    """A slim tree, pruned so high that a bus passes beneath its crown."""
    return broadleaf(rng, max_radius_m=1.7, trunk_m=4.0)


def conifer(rng: Rng) -> list[Solid]:
    """A spruce of 6 to 11 m: three stacked cones on a trunk."""
    height, width = rng.uniform(6, 11), rng.uniform(2.6, 3.8)
    solids = [_trunk(0.3, 0.4 * height)]

    for k in range(3):
        low, size = (0.14 + 0.24 * k) * height, width * (1 - 0.24 * k)
        # The uppermost cone ends at the tree's height, the others overlap the next.
        tall = 0.42 * height if k < 2 else height - low
        center = (0, 0, low + tall / 2)
        solids.append(part("cone", VEGETATION, "needles", (size, size, tall), center))
    return solids


def bush(rng: Rng) -> list[Solid]:
    """Two or three low lobes, 0.8 to 1.6 m tall."""
    foliage = rng.choice(_CROWNS, p=_CROWN_SHARES)
    solids = []
    for k in range(rng.integers(2, 4)):
        wide, tall = rng.uniform(1.0, 1.7), rng.uniform(0.9, 1.6)
        x, y = (0.0, 0.0) if k == 0 else rng.uniform(-0.4, 0.4, 2)
        center = (x, y, 0.35 * tall)
        solids.append(part("ellipsoid", VEGETATION, foliage, (wide, wide, tall), center))
    return solids


def hedge(rng: Rng, length_m: float) -> list[Solid]:
    """A clipped hedge along y."""
    height, depth = rng.uniform(0.9, 1.5), rng.uniform(0.5, 0.8)
    size_m = (depth, length_m, height - ROOT_M)
    return [box(VEGETATION, "foliage_dark", size_m, (0, 0, (height + ROOT_M) / 2))]


def bare_tree(rng: Rng) -> list[Solid]:
    """A leafless tree of 6 to 8 m: boughs of 8 to 14 cm that fork into twigs of 4 to 6 cm."""
    top = rng.uniform(2.4, 3.2)
    solids = [_trunk(0.3, top)]

    start = rng.uniform(0, 2 * np.pi)
    for angle in start + np.arange(5) * 2 * np.pi / 5:
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        side = np.array([-np.sin(angle), np.cos(angle), 0.0])
        root = np.array([0, 0, top - rng.uniform(0.05, 0.6)])
        fork = root + rng.uniform(0.8, 1.4) * out + [0, 0, rng.uniform(1.2, 1.8)]
        solids.append(beam(THIN_STRUCTURE, "bark", rng.uniform(0.08, 0.14), root, fork))

        # The rise is drawn before the reach: the order of draws is part of a town's bytes.
        for swing in (-0.7, 0.1, 0.8):
            rise = [0, 0, rng.uniform(0.7, 1.6)]
            tip = fork + rng.uniform(0.6, 1.1) * (out + swing * side) + rise
            solids.append(beam(THIN_STRUCTURE, "bark", rng.uniform(0.04, 0.06), fork, tip))
    return solids
