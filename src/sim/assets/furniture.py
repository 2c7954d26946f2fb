"""What stands in streets: thin structures (lamps, signals, signs, poles, wires, fences) and
general things (benches, bins, barriers, containers, stalls). Fronts look along +x.
"""

from itertools import pairwise

import numpy as np

from ...ontology import GENERAL, THIN_STRUCTURE
from .. import textures as colours
from ..solid import Solid
from .parts import ROOT_M, Vector, beam, part

WIRE_SEGMENTS = 6


def _post(material: str, diameter_m: float, top_m: float, x_m: float = 0.0, y_m: float = 0.0):
    return beam(THIN_STRUCTURE, material, (x_m, y_m, ROOT_M), (x_m, y_m, top_m), diameter_m)


# ------------------------------------------------------------------------------ thin structures


def lamp_post(rng: np.random.Generator, reach_m: float = 1.8) -> list[Solid]:
    """A street lamp of 6 to 7.5 m with an arm over the road."""
    height, metal = rng.uniform(6.0, 7.5), str(rng.choice(colours.METAL[:3]))
    head = part(
        "box", THIN_STRUCTURE, colours.METAL[3], (0.7, 0.25, 0.12), (reach_m, 0, height + 0.12)
    )
    arm = beam(THIN_STRUCTURE, metal, (0, 0, height - 0.2), (reach_m, 0, height + 0.15), 0.09)
    base = part("cylinder", THIN_STRUCTURE, metal, (0.3, 0.3, 0.8), (0, 0, 0.2))
    return [_post(metal, 0.16, height), base, arm, head]


def park_lamp(rng: np.random.Generator) -> list[Solid]:
    """A low lamp with a globe."""
    height = rng.uniform(3.2, 3.8)
    globe = (0, 0, height + 0.2)
    return [
        _post(colours.METAL[0], 0.12, height),
        part("ellipsoid", THIN_STRUCTURE, colours.HEADLIGHT, (0.45, 0.45, 0.45), globe),
    ]


def _signal_head(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> list[Solid]:
    """A box with three lights; the colours do not change during a clip."""
    out = 0.14 * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    lights = (colours.SIGNAL_RED, colours.SIGNAL_AMBER, colours.SIGNAL_GREEN)
    centre = (x_m, y_m, z_m)
    case = part("box", THIN_STRUCTURE, colours.TYRE, (0.24, 0.36, 1.0), centre, yaw_rad)
    lamps = [
        part(
            "ellipsoid",
            THIN_STRUCTURE,
            light,
            (0.1, 0.24, 0.24),
            (x_m + out[0], y_m + out[1], z_m + 0.31 * (1 - k)),
            yaw_rad,
        )
        for k, light in enumerate(lights)
    ]
    return [case, *lamps]


def traffic_light(rng: np.random.Generator, reach_m: float) -> list[Solid]:
    """A mast with an arm along +x; its heads look along +y, at the oncoming traffic."""
    height = rng.uniform(5.6, 6.4)
    arm = beam(THIN_STRUCTURE, colours.METAL[1], (0, 0, height), (reach_m, 0, height), 0.12)
    solids = [_post(colours.METAL[1], 0.2, height + 0.3), arm]
    for x, z in ((0.0, 3.0), (reach_m - 0.4, height - 0.2)):
        solids += _signal_head(x, 0.2, z, np.pi / 2)
    return solids


def sign_post(rng: np.random.Generator) -> list[Solid]:
    """A traffic sign on a pole: its plate looks along +y."""
    height = rng.uniform(2.3, 2.8)
    plate = str(rng.choice([colours.SIGN_RED, colours.SIGN_BLUE, colours.SIGN_WHITE]))
    solids = [_post(colours.METAL[2], 0.08, height)]
    if rng.random() < 0.5:
        size_m, centre = (0.7, 0.06, 0.7), (0, 0.06, height - 0.35)
        return [*solids, part("box", THIN_STRUCTURE, plate, size_m, centre)]
    disc = beam(THIN_STRUCTURE, plate, (0, 0.04, height - 0.3), (0, 0.1, height - 0.3), 0.7)
    inner = beam(
        THIN_STRUCTURE, colours.SIGN_WHITE, (0, 0.05, height - 0.3), (0, 0.12, height - 0.3), 0.45
    )
    return [*solids, disc, inner]


def utility_pole(rng: np.random.Generator, height_m: float) -> list[Solid]:
    """A timber pole whose crossarm lies along x; `wire_ends` says where the wires hang."""
    arm = beam(
        THIN_STRUCTURE, colours.TIMBER, (-0.9, 0, height_m - 0.4), (0.9, 0, height_m - 0.4), 0.13
    )
    solids = [_post(colours.TIMBER, 0.24, height_m), arm]
    if rng.random() < 0.3:
        case = (-0.3, 0, height_m - 1.6)
        solids.append(part("cylinder", THIN_STRUCTURE, colours.METAL[2], (0.5, 0.5, 0.9), case))
    return solids


def wire_ends(height_m: float) -> tuple[Vector, ...]:
    """Where wires are fixed on a `utility_pole`, in its own frame."""
    arm_m = height_m - 0.34
    return (-0.8, 0.0, arm_m), (0.8, 0.0, arm_m), (0.0, 0.0, height_m - 0.02)


def wire(start_m: Vector, end_m: Vector, sag_m: float, thickness_m: float = 0.04) -> list[Solid]:
    """A sagging cable from point to point: a chain of thin cylinders along a parabola."""
    t = np.linspace(0, 1, WIRE_SEGMENTS + 1)[:, None]
    points = (1 - t) * np.asarray(start_m) + t * np.asarray(end_m)
    points[:, 2:] -= 4 * sag_m * t * (1 - t)
    return [beam(THIN_STRUCTURE, colours.CABLE, a, b, thickness_m) for a, b in pairwise(points)]


def span_wire(rng: np.random.Generator, width_m: float) -> list[Solid]:
    """Two poles with a cable along x across a whole street, and a lamp that hangs from it."""
    height, half, sag = rng.uniform(6.4, 7.4), width_m / 2, rng.uniform(0.3, 0.6)
    solids = [_post(colours.METAL[0], 0.16, height + 0.1, x_m=side * half) for side in (-1, 1)]
    solids += wire((-half, 0, height), (half, 0, height), sag)
    lamp = (0, 0, height - sag - 0.2)
    solids.append(part("cone", THIN_STRUCTURE, colours.METAL[1], (0.5, 0.5, 0.42), lamp))
    return solids


def fence(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """Posts, rails and pickets along y, 1.1 to 1.5 m tall."""
    height = rng.uniform(1.1, 1.5)
    material = str(rng.choice([colours.TIMBER, colours.SIGN_WHITE, colours.METAL[1]]))
    count = max(2, round(length_m / 2.0) + 1)
    solids = [_post(material, 0.1, height, y_m=y) for y in np.linspace(-0.5, 0.5, count) * length_m]
    for z in (0.35, 0.7, height - 0.1):
        size_m = (0.05, length_m, 0.1)
        solids.append(part("box", THIN_STRUCTURE, material, size_m, (0, 0, z)))
    return solids


def railing(rng: np.random.Generator, length_m: float) -> list[Solid]:
    """A steel guard rail along y."""
    metal = str(rng.choice(colours.METAL[:2]))
    count = max(2, round(length_m / 1.5) + 1)
    solids = [_post(metal, 0.07, 1.05, y_m=y) for y in np.linspace(-0.5, 0.5, count) * length_m]
    half = length_m / 2
    for z in (0.55, 1.05):
        solids.append(beam(THIN_STRUCTURE, metal, (0, -half, z), (0, half, z), 0.06))
    return solids


# ---------------------------------------------------------------------------------- general


def bench(rng: np.random.Generator) -> list[Solid]:
    """A bench of 1.6 to 2 m along y, to be sat on looking along +x."""
    length = rng.uniform(1.6, 2.0)
    solids = [
        part("box", GENERAL, "planks", (0.45, length, 0.08), (0, 0, 0.45)),
        part("box", GENERAL, "planks", (0.08, length, 0.45), (-0.25, 0, 0.72), tilt_rad=-0.15),
    ]
    for side in (-1, 1):
        leg = (-0.02, side * (length / 2 - 0.2), 0.13)
        solids.append(part("box", GENERAL, colours.METAL[0], (0.42, 0.1, 0.66), leg))
    return solids


def litter_bin(rng: np.random.Generator) -> list[Solid]:
    """A litter bin with a lid."""
    paint = str(rng.choice([colours.BIN_GREEN, colours.BIN_GREY]))
    return [
        part("cylinder", GENERAL, paint, (0.5, 0.5, 1.1), (0, 0, 0.35)),
        part("cylinder", GENERAL, colours.METAL[0], (0.56, 0.56, 0.1), (0, 0, 0.92)),
    ]


def barrier(rng: np.random.Generator) -> list[Solid]:
    """A striped road-works barrier of 2 to 2.6 m along y."""
    length = rng.uniform(2.0, 2.6)
    board = part("box", GENERAL, "barrier", (0.1, length, 0.35), (0, 0, 0.85))
    low = part("box", GENERAL, "barrier", (0.1, length, 0.2), (0, 0, 0.4))
    feet = [
        part("box", GENERAL, colours.BARRIER_ORANGE, (0.6, 0.12, 1.2), (0, s * length / 3, 0.4))
        for s in (-1, 1)
    ]
    return [board, low, *feet]


def traffic_cone(rng: np.random.Generator) -> list[Solid]:
    """A traffic cone."""
    height = rng.uniform(0.7, 0.9)
    return [
        part("cone", GENERAL, colours.BARRIER_ORANGE, (0.4, 0.4, height), (0, 0, height / 2)),
        part("box", GENERAL, colours.TYRE, (0.45, 0.45, 0.3), (0, 0, -0.05)),
    ]


def container(rng: np.random.Generator) -> list[Solid]:
    """A skip or a short freight container along y."""
    material = str(rng.choice(["corrugated_red", "corrugated_blue"]))
    length, height = rng.uniform(3.0, 6.0), rng.uniform(1.6, 2.5)
    size_m = (2.2, length, height - ROOT_M)
    lid = part("box", GENERAL, colours.METAL[1], (2.3, length + 0.1, 0.1), (0, 0, height))
    return [part("box", GENERAL, material, size_m, (0, 0, (height + ROOT_M) / 2)), lid]


def stall(rng: np.random.Generator) -> list[Solid]:
    """A market stall: a counter with goods under a striped roof on four legs."""
    width = rng.uniform(2.4, 3.2)
    roof = str(rng.choice(["awning_red", "awning_green"]))
    legs = [(x, y * (width / 2 - 0.1)) for x in (-0.9, 0.9) for y in (-1, 1)]
    solids = [part("box", GENERAL, "planks", (1.0, width - 0.4, 1.1), (0.2, 0, 0.35))]
    solids += [beam(GENERAL, colours.TIMBER, (x, y, ROOT_M), (x, y, 2.4), 0.09) for x, y in legs]
    solids.append(part("box", GENERAL, roof, (2.3, width, 0.1), (0, 0, 2.45), tilt_rad=0.12))
    for y in np.linspace(-0.35, 0.35, 3) * width:
        goods = str(rng.choice(colours.SHIRTS))
        solids.append(part("box", GENERAL, goods, (0.6, 0.5, 0.25), (0.3, y, 1.0)))
    return solids


def climbing_frame(rng: np.random.Generator) -> list[Solid]:
    """Playground bars of thin steel: two rows of posts and rungs."""
    paint, length = str(rng.choice(colours.CAR_PAINT)), rng.uniform(2.4, 4.0)
    solids = []
    for x in (-0.8, 0.8):
        for y in (-length / 2, length / 2):
            solids.append(_post(paint, 0.09, 2.3, x, y))
        rail = ((x, -length / 2, 2.3), (x, length / 2, 2.3))
        solids.append(beam(THIN_STRUCTURE, paint, *rail, 0.08))
    for y in np.linspace(-length / 2, length / 2, 6):
        solids.append(beam(THIN_STRUCTURE, paint, (-0.8, y, 2.3), (0.8, y, 2.3), 0.06))
    return solids
