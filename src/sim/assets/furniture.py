"""What stands in streets: thin structures (lamps, traffic lights, signs, poles, wires, fences) and
general things (benches, bins, barriers, containers, stalls). Fronts look along +x.
"""

from itertools import pairwise

import numpy as np

from ...ontology import GENERAL, THIN_STRUCTURE
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import ROOT_M, Vector, beam, beams, box, boxes, part, posts

# Pieces of a sagging wire: enough for a parabola that shows no corners from the air.
WIRE_SEGMENTS = 6

_MIDDLE = ((0.0, 0.0),)

# ------------------------------------------------------------------------------ thin structures


def lamp_post(rng: Rng) -> list[Solid]:
    """A street lamp of 6 to 7.5 m with an arm over the road."""
    height, metal, reach = rng.uniform(6.0, 7.5), rng.choice(colors.METAL[:3]), 1.8
    return [
        *posts(THIN_STRUCTURE, metal, 0.16, _MIDDLE, height),
        part("cylinder", THIN_STRUCTURE, metal, (0.3, 0.3, 0.8), (0, 0, 0.2)),
        beam(THIN_STRUCTURE, metal, 0.09, (0, 0, height - 0.2), (reach, 0, height + 0.15)),
        box(THIN_STRUCTURE, colors.METAL[3], (0.7, 0.25, 0.12), (reach, 0, height + 0.12)),
    ]


def park_lamp(rng: Rng) -> list[Solid]:
    """A low lamp with a globe."""
    height = rng.uniform(3.2, 3.8)
    globe = (0, 0, height + 0.2)
    return [
        *posts(THIN_STRUCTURE, colors.METAL[0], 0.12, _MIDDLE, height),
        part("ellipsoid", THIN_STRUCTURE, colors.HEADLIGHT, (0.45, 0.45, 0.45), globe),
    ]


def _light_head(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> list[Solid]:
    """A box with three lights; the colors do not change during a clip."""
    out = 0.14 * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    solids = [box(THIN_STRUCTURE, colors.TYRE, (0.24, 0.36, 1.0), (x_m, y_m, z_m), yaw_rad)]

    for k, glass in enumerate(colors.LIGHTS):
        center = (x_m + out[0], y_m + out[1], z_m + 0.31 * (1 - k))
        size_m = (0.1, 0.24, 0.24)
        solids.append(part("ellipsoid", THIN_STRUCTURE, glass, size_m, center, yaw_rad))
    return solids


def traffic_light(rng: Rng, reach_m: float) -> list[Solid]:
    """A mast with an arm along +x; its heads look along +y, at the oncoming traffic."""
    height, metal = rng.uniform(5.6, 6.4), colors.METAL[1]
    return [
        *posts(THIN_STRUCTURE, metal, 0.2, _MIDDLE, height + 0.3),
        beam(THIN_STRUCTURE, metal, 0.12, (0, 0, height), (reach_m, 0, height)),
        *_light_head(0.0, 0.2, 3.0, np.pi / 2),
        *_light_head(reach_m - 0.4, 0.2, height - 0.2, np.pi / 2),
    ]


def sign_post(rng: Rng) -> list[Solid]:
    """A traffic sign on a pole: its plate looks along +y."""
    height = rng.uniform(2.3, 2.8)
    plate = rng.choice(colors.SIGNS)
    pole = posts(THIN_STRUCTURE, colors.METAL[2], 0.08, _MIDDLE, height)
    if rng.random() < 0.5:
        return [*pole, box(THIN_STRUCTURE, plate, (0.7, 0.06, 0.7), (0, 0.06, height - 0.35))]

    # A disc with a smaller white one before it: a ring, as a speed limit has.
    z = height - 0.3
    return [
        *pole,
        beam(THIN_STRUCTURE, plate, 0.7, (0, 0.04, z), (0, 0.1, z)),
        beam(THIN_STRUCTURE, colors.SIGN_WHITE, 0.45, (0, 0.05, z), (0, 0.12, z)),
    ]


def utility_pole(rng: Rng, height_m: float) -> list[Solid]:
    """A timber pole whose crossarm lies along x; `wire_ends` says where the wires hang."""
    z = height_m - 0.4
    solids = posts(THIN_STRUCTURE, colors.TIMBER, 0.24, _MIDDLE, height_m)
    solids.append(beam(THIN_STRUCTURE, colors.TIMBER, 0.13, (-0.9, 0, z), (0.9, 0, z)))

    # Some poles carry a transformer.
    if rng.random() < 0.3:
        size_m, center = (0.5, 0.5, 0.9), (-0.3, 0, height_m - 1.6)
        solids.append(part("cylinder", THIN_STRUCTURE, colors.METAL[2], size_m, center))
    return solids


def wire_ends(height_m: float) -> tuple[Vector, ...]:
    """Returns where wires are fixed on a `utility_pole`, in its own frame."""
    arm_m = height_m - 0.34
    return (-0.8, 0.0, arm_m), (0.8, 0.0, arm_m), (0.0, 0.0, height_m - 0.02)


def wire(start_m: Vector, end_m: Vector, sag_m: float) -> list[Solid]:
    """A sagging cable from point to point: a chain of thin cylinders along a parabola."""
    t = np.linspace(0, 1, WIRE_SEGMENTS + 1)[:, None]
    points = (1 - t) * np.asarray(start_m) + t * np.asarray(end_m)
    points[:, 2:] -= 4 * sag_m * t * (1 - t)
    return beams(THIN_STRUCTURE, colors.CABLE, 0.04, pairwise(points))


def span_wire(rng: Rng, width_m: float) -> list[Solid]:
    """Two poles with a cable along x across a whole street, and a lamp that hangs from it."""
    height, half, sag = rng.uniform(6.4, 7.4), width_m / 2, rng.uniform(0.3, 0.6)
    return [
        *posts(THIN_STRUCTURE, colors.METAL[0], 0.16, [(-half, 0), (half, 0)], height + 0.1),
        *wire((-half, 0, height), (half, 0, height), sag),
        part("cone", THIN_STRUCTURE, colors.METAL[1], (0.5, 0.5, 0.42), (0, 0, height - sag - 0.2)),
    ]


def _feet(length_m: float, spacing_m: float) -> list[Vector]:
    """Places of the posts of a fence along y, at both its ends and evenly between them."""
    count = max(2, round(length_m / spacing_m) + 1)
    return [(0.0, y) for y in np.linspace(-0.5, 0.5, count) * length_m]


def fence(rng: Rng, length_m: float) -> list[Solid]:
    """Posts and rails along y, 1.1 to 1.5 m tall."""
    height = rng.uniform(1.1, 1.5)
    material = rng.choice([colors.TIMBER, colors.SIGN_WHITE, colors.METAL[1]])
    rails = ((material, (0.05, length_m, 0.1), (0, 0, z)) for z in (0.35, 0.7, height - 0.1))
    return [
        *posts(THIN_STRUCTURE, material, 0.1, _feet(length_m, 2.0), height),
        *boxes(THIN_STRUCTURE, rails),
    ]


def railing(rng: Rng, length_m: float) -> list[Solid]:
    """A steel guard rail along y."""
    metal, half = rng.choice(colors.METAL[:2]), length_m / 2
    rails = [((0, -half, z), (0, half, z)) for z in (0.55, 1.05)]
    return [
        *posts(THIN_STRUCTURE, metal, 0.07, _feet(length_m, 1.5), 1.05),
        *beams(THIN_STRUCTURE, metal, 0.06, rails),
    ]


def climbing_frame(rng: Rng) -> list[Solid]:
    """Playground bars of thin steel: two rows of posts and rungs."""
    paint, half = rng.choice(colors.CAR_PAINT), rng.uniform(2.4, 4.0) / 2
    solids = []
    for x in (-0.8, 0.8):
        solids += posts(THIN_STRUCTURE, paint, 0.09, [(x, -half), (x, half)], 2.3)
        solids.append(beam(THIN_STRUCTURE, paint, 0.08, (x, -half, 2.3), (x, half, 2.3)))
    rungs = [((-0.8, y, 2.3), (0.8, y, 2.3)) for y in np.linspace(-half, half, 6)]
    return solids + beams(THIN_STRUCTURE, paint, 0.06, rungs)


# ---------------------------------------------------------------------------------- general


def bench(rng: Rng) -> list[Solid]:
    """A bench of 1.6 to 2 m along y, to be sat on looking along +x."""
    length = rng.uniform(1.6, 2.0)
    y = length / 2 - 0.2
    rows = (
        ("planks", (0.45, length, 0.08), (0, 0, 0.45)),
        ("planks", (0.08, length, 0.45), (-0.25, 0, 0.72), 0.0, -0.15),
        (colors.METAL[0], (0.42, 0.1, 0.66), (-0.02, -y, 0.13)),
        (colors.METAL[0], (0.42, 0.1, 0.66), (-0.02, y, 0.13)),
    )
    return boxes(GENERAL, rows)


def litter_bin(rng: Rng) -> list[Solid]:
    """A litter bin with a lid."""
    paint = rng.choice([colors.BIN_GREEN, colors.BIN_GREY])
    return [
        part("cylinder", GENERAL, paint, (0.5, 0.5, 1.1), (0, 0, 0.35)),
        part("cylinder", GENERAL, colors.METAL[0], (0.56, 0.56, 0.1), (0, 0, 0.92)),
    ]


def barrier(rng: Rng) -> list[Solid]:
    """A striped road-works barrier of 2 to 2.6 m along y."""
    length = rng.uniform(2.0, 2.6)
    rows = (
        ("barrier", (0.1, length, 0.35), (0, 0, 0.85)),
        ("barrier", (0.1, length, 0.2), (0, 0, 0.4)),
        (colors.BARRIER_ORANGE, (0.6, 0.12, 1.2), (0, -length / 3, 0.4)),
        (colors.BARRIER_ORANGE, (0.6, 0.12, 1.2), (0, length / 3, 0.4)),
    )
    return boxes(GENERAL, rows)


def traffic_cone(rng: Rng) -> list[Solid]:
    """A traffic cone."""
    height = rng.uniform(0.7, 0.9)
    return [
        part("cone", GENERAL, colors.BARRIER_ORANGE, (0.4, 0.4, height), (0, 0, height / 2)),
        box(GENERAL, colors.TYRE, (0.45, 0.45, 0.3), (0, 0, -0.05)),
    ]


def container(rng: Rng) -> list[Solid]:
    """A skip or a short freight container along y."""
    material = rng.choice(["corrugated_red", "corrugated_blue"])
    length, height = rng.uniform(3.0, 6.0), rng.uniform(1.6, 2.5)
    rows = (
        (material, (2.2, length, height - ROOT_M), (0, 0, (height + ROOT_M) / 2)),
        (colors.METAL[1], (2.3, length + 0.1, 0.1), (0, 0, height)),
    )
    return boxes(GENERAL, rows)


def stall(rng: Rng) -> list[Solid]:
    """A market stall: a counter with goods under a striped roof on four legs."""
    width = rng.uniform(2.4, 3.2)
    roof = rng.choice(["awning_red", "awning_green"])
    legs = [(x, y * (width / 2 - 0.1)) for x in (-0.9, 0.9) for y in (-1, 1)]

    ys = np.linspace(-0.35, 0.35, 3) * width
    goods = [(rng.choice(colors.SHIRTS), (0.6, 0.5, 0.25), (0.3, y, 1.0)) for y in ys]
    return [
        box(GENERAL, "planks", (1.0, width - 0.4, 1.1), (0.2, 0, 0.35)),
        *posts(GENERAL, colors.TIMBER, 0.09, legs, 2.4),
        box(GENERAL, roof, (2.3, width, 0.1), (0, 0, 2.45), 0.0, 0.12),
        *boxes(GENERAL, goods),
    ]
