"""People, on foot and on two wheels, in the actor frame; a machine and its rider are one VRU."""

import numpy as np

from ...ontology import VRU
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import beam, beams, box, part


def pedestrian(rng: Rng) -> tuple[Solid, ...]:
    """Somebody of 1.6 to 1.9 m in mid-stride."""
    height = rng.uniform(1.6, 1.9)
    shirt, trousers = rng.choice(colors.SHIRTS), rng.choice(colors.TROUSERS)
    skin, hair = rng.choice(colors.SKIN), rng.choice(colors.HAIR)
    stride = rng.uniform(0.1, 0.25)

    # Arms swing against the legs. Joints are at a grown person's shares of the height.
    hip, shoulder = 0.50 * height, 0.82 * height
    sides = (-1, 1)
    legs = [((side * stride, side * 0.09, 0.0), (0, side * 0.09, hip)) for side in sides]
    arms = [((-side * stride, side * 0.27, hip), (0, side * 0.21, shoulder)) for side in sides]

    torso = (0.24, 0.40, shoulder - hip + 0.1)
    return (
        *beams(VRU, trousers, 0.15, legs),
        *beams(VRU, shirt, 0.10, arms),
        part("cylinder", VRU, shirt, torso, (0, 0, (hip + shoulder) / 2)),
        part("ellipsoid", VRU, skin, (0.21, 0.18, 0.25), (0, 0, height - 0.15)),
        part("ellipsoid", VRU, hair, (0.23, 0.20, 0.14), (-0.02, 0, height - 0.07)),
    )


def _rider(rng: Rng, seat_m: float, lean_m: float) -> list[Solid]:
    """Somebody seated above the origin, hands forward, feet at 0.3 m, with a helmet."""
    shirt, trousers = rng.choice(colors.SHIRTS), rng.choice(colors.TROUSERS)
    foot_m, shoulder_m = 0.3, seat_m + 0.55

    solids = [beam(VRU, shirt, 0.34, (-0.05, 0, seat_m - 0.05), (lean_m, 0.0, shoulder_m))]
    for side in (-1, 1):
        knee = (0.28, side * 0.16, (seat_m + foot_m) / 2 + 0.12)
        elbow = (lean_m, side * 0.18, shoulder_m - 0.05)
        solids += [
            beam(VRU, trousers, 0.15, (-0.05, side * 0.10, seat_m), knee),
            beam(VRU, trousers, 0.12, knee, (0.08, side * 0.14, foot_m)),
            beam(VRU, shirt, 0.09, elbow, (lean_m + 0.35, side * 0.26, seat_m + 0.22)),
        ]

    head = (lean_m + 0.04, 0, shoulder_m + 0.22)
    helmet = (head[0] - 0.02, 0, head[2] + 0.06)
    solids.append(part("ellipsoid", VRU, rng.choice(colors.SKIN), (0.2, 0.18, 0.26), head))
    paint = rng.choice(colors.SHIRTS)
    return [*solids, part("ellipsoid", VRU, paint, (0.27, 0.22, 0.2), helmet)]


def _wheel(x_m: float, diameter_m: float, thickness_m: float) -> Solid:
    size_m, center_m = (diameter_m, diameter_m, thickness_m), (x_m, 0, diameter_m / 2)
    return part("cylinder", VRU, colors.TYRE, size_m, center_m, np.pi / 2, np.pi / 2)


def bicycle(rng: Rng) -> tuple[Solid, ...]:
    """A bicycle of about 1.75 m with its rider."""
    paint = rng.choice(colors.CAR_PAINT)

    # The tubes of the frame run between these joints.
    crank, seat, bars = (0.0, 0, 0.32), (-0.12, 0, 0.88), (0.42, 0, 0.92)
    rear, front = (-0.53, 0, 0.34), (0.53, 0, 0.34)
    tubes = ((crank, seat), (seat, bars), (crank, bars), (crank, rear), (front, bars))

    return (
        _wheel(rear[0], 0.68, 0.05),
        _wheel(front[0], 0.68, 0.05),
        *beams(VRU, paint, 0.05, tubes),
        beam(VRU, colors.METAL[0], 0.04, (bars[0], -0.28, 1.0), (bars[0], 0.28, 1.0)),
        *_rider(rng, seat_m=0.95, lean_m=0.16),
    )


def motorcycle(rng: Rng) -> tuple[Solid, ...]:
    """A motorcycle or scooter of about 2.1 m with its rider."""
    paint = rng.choice(colors.CAR_PAINT)

    return (
        _wheel(-0.72, 0.62, 0.16),
        _wheel(0.72, 0.62, 0.14),
        box(VRU, colors.METAL[0], (0.7, 0.32, 0.4), (0.0, 0, 0.45)),
        part("ellipsoid", VRU, paint, (0.7, 0.36, 0.34), (0.22, 0, 0.8)),
        box(VRU, colors.TYRE, (0.8, 0.3, 0.12), (-0.35, 0, 0.76)),
        box(VRU, paint, (0.35, 0.26, 0.2), (-0.8, 0, 0.74)),
        beam(VRU, colors.METAL[2], 0.12, (0.72, 0, 0.31), (0.45, 0, 1.0)),
        beam(VRU, colors.METAL[0], 0.05, (0.42, -0.36, 1.02), (0.42, 0.36, 1.02)),
        box(VRU, colors.HEADLIGHT, (0.1, 0.2, 0.16), (0.62, 0, 0.88)),
        *_rider(rng, seat_m=0.82, lean_m=0.1),
    )
