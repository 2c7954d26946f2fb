"""People, on foot and on two wheels, in the actor frame; a machine and its rider are one VRU."""

import numpy as np

from ...ontology import VRU
from .. import textures as colours
from ..solid import Solid
from .parts import beam, part


def pedestrian(rng: np.random.Generator) -> tuple[Solid, ...]:
    """Somebody of 1.6 to 1.9 m in mid-stride."""
    height = rng.uniform(1.6, 1.9)
    shirt, trousers = str(rng.choice(colours.SHIRTS)), str(rng.choice(colours.TROUSERS))
    skin, hair = str(rng.choice(colours.SKIN)), str(rng.choice(colours.HAIR))
    stride = rng.uniform(0.1, 0.25)
    hip, shoulder = 0.50 * height, 0.82 * height
    solids = [
        beam(VRU, trousers, (side * stride, side * 0.09, 0.0), (0, side * 0.09, hip), 0.15)
        for side in (-1, 1)
    ]
    solids += [
        beam(VRU, shirt, (-side * stride, side * 0.27, hip), (0, side * 0.21, shoulder), 0.10)
        for side in (-1, 1)
    ]
    torso = (0.24, 0.40, shoulder - hip + 0.1)
    solids.append(part("cylinder", VRU, shirt, torso, (0, 0, (hip + shoulder) / 2)))
    solids.append(part("ellipsoid", VRU, skin, (0.21, 0.18, 0.25), (0, 0, height - 0.15)))
    solids.append(part("ellipsoid", VRU, hair, (0.23, 0.20, 0.14), (-0.02, 0, height - 0.07)))
    return tuple(solids)


def _rider(rng: np.random.Generator, seat_m: float, lean_m: float, foot_m: float) -> list[Solid]:
    """Somebody seated above the origin, hands forward, with a helmet."""
    shirt, trousers = str(rng.choice(colours.SHIRTS)), str(rng.choice(colours.TROUSERS))
    shoulder = (lean_m, 0.0, seat_m + 0.55)
    solids = [beam(VRU, shirt, (-0.05, 0, seat_m - 0.05), shoulder, 0.34)]
    for side in (-1, 1):
        knee = (0.28, side * 0.16, (seat_m + foot_m) / 2 + 0.12)
        solids += [
            beam(VRU, trousers, (-0.05, side * 0.10, seat_m), knee, 0.15),
            beam(VRU, trousers, knee, (0.08, side * 0.14, foot_m), 0.12),
            beam(
                VRU,
                shirt,
                (lean_m, side * 0.18, shoulder[2] - 0.05),
                (lean_m + 0.35, side * 0.26, seat_m + 0.22),
                0.09,
            ),
        ]
    head = (lean_m + 0.04, 0, shoulder[2] + 0.22)
    solids.append(part("ellipsoid", VRU, str(rng.choice(colours.SKIN)), (0.2, 0.18, 0.26), head))
    helmet = (head[0] - 0.02, 0, head[2] + 0.06)
    helmet_paint = str(rng.choice(colours.SHIRTS))
    solids.append(part("ellipsoid", VRU, helmet_paint, (0.27, 0.22, 0.2), helmet))
    return solids


def _wheel(x_m: float, diameter_m: float, thickness_m: float) -> Solid:
    size_m, centre_m = (diameter_m, diameter_m, thickness_m), (x_m, 0, diameter_m / 2)
    return part("cylinder", VRU, colours.TYRE, size_m, centre_m, np.pi / 2, np.pi / 2)


def bicycle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A bicycle of about 1.75 m with its rider."""
    paint = str(rng.choice(colours.CAR_PAINT))
    crank, seat, bars = (0.0, 0, 0.32), (-0.12, 0, 0.88), (0.42, 0, 0.92)
    rear, front = (-0.53, 0, 0.34), (0.53, 0, 0.34)
    solids = [_wheel(rear[0], 0.68, 0.05), _wheel(front[0], 0.68, 0.05)]
    for start, end in ((crank, seat), (seat, bars), (crank, bars), (crank, rear), (front, bars)):
        solids.append(beam(VRU, paint, start, end, 0.05))
    handles = ((bars[0], -0.28, 1.0), (bars[0], 0.28, 1.0))
    solids.append(beam(VRU, colours.METAL[0], *handles, 0.04))
    return tuple(solids + _rider(rng, seat_m=0.95, lean_m=0.16, foot_m=0.3))


def motorcycle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A motorcycle or scooter of about 2.1 m with its rider."""
    paint = str(rng.choice(colours.CAR_PAINT))
    solids = [
        _wheel(-0.72, 0.62, 0.16),
        _wheel(0.72, 0.62, 0.14),
        part("box", VRU, colours.METAL[0], (0.7, 0.32, 0.4), (0.0, 0, 0.45)),
        part("ellipsoid", VRU, paint, (0.7, 0.36, 0.34), (0.22, 0, 0.8)),
        part("box", VRU, colours.TYRE, (0.8, 0.3, 0.12), (-0.35, 0, 0.76)),
        part("box", VRU, paint, (0.35, 0.26, 0.2), (-0.8, 0, 0.74)),
        beam(VRU, colours.METAL[2], (0.72, 0, 0.31), (0.45, 0, 1.0), 0.12),
        beam(VRU, colours.METAL[0], (0.42, -0.36, 1.02), (0.42, 0.36, 1.02), 0.05),
        part("box", VRU, colours.HEADLIGHT, (0.1, 0.2, 0.16), (0.62, 0, 0.88)),
    ]
    return tuple(solids + _rider(rng, seat_m=0.82, lean_m=0.1, foot_m=0.3))
