"""The moving actors: vehicles, people on foot, and people on two wheels.

An actor's frame has x forward, y left and z up, with its origin on the ground under the middle. A
bicycle or a motorcycle and its rider are one actor, a VRU.
"""

from collections.abc import Callable

import numpy as np

from ...ontology import CAR, LARGE_VEHICLE, VRU
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import Rows, Vector, beam, beams, box, boxes, part

# Length, width, height, and bonnet and boot as fractions of the length.
_CAR_SHAPES = (
    (4.7, 1.82, 1.45, 0.27, 0.17),  # a sedan
    (4.25, 1.80, 1.50, 0.25, 0.03),  # a hatchback
    (4.85, 1.84, 1.50, 0.26, 0.03),  # an estate
    (4.75, 1.92, 1.72, 0.25, 0.03),  # a sport utility vehicle
)


def _wheel(class_id: int, x_m: float, y_m: float, diameter_m: float, thickness_m: float) -> Solid:
    size_m, center_m = (diameter_m, diameter_m, thickness_m), (x_m, y_m, diameter_m / 2)
    return part("cylinder", class_id, colors.TYRE, size_m, center_m, np.pi / 2, np.pi / 2)


def _vehicle(
    class_id: int, size_m: Vector, rows: Rows, axles_m: Vector, wheel_m: float, lamps_m: float
) -> tuple[Solid, ...]:
    """Boxes on wheels with lamps; ``axles_m`` are places along x, ``lamps_m`` is a height."""
    length, width = size_m
    track_m = (0.13 - width / 2, width / 2 - 0.13)
    wheels = [_wheel(class_id, x, y, wheel_m, 0.25) for x in axles_m for y in track_m]

    # The lamps stand out of the front and the back by a centimetre, so that they are seen.
    lamps = []
    for end, glass in ((1, colors.HEADLIGHT), (-1, colors.TAIL_LIGHT)):
        x = end * (length / 2 - 0.02)
        for side in (1, -1):
            y = side * (width / 2 - 0.25)
            lamps.append((glass, (0.06, 0.32, 0.16), (x, y, lamps_m)))
    return tuple(boxes(class_id, rows) + wheels + boxes(class_id, lamps))


def car(rng: Rng) -> tuple[Solid, ...]:
    """A sedan, hatchback, estate or sport utility vehicle of 4.2 to 4.9 m."""
    length, width, height, bonnet, boot = _CAR_SHAPES[rng.integers(len(_CAR_SHAPES))]
    paint = rng.choice(colors.CAR_PAINT)

    # The belt is the line under the side windows.
    belt = 0.58 * height
    cabin = length * (1 - bonnet - boot)
    x = length * (boot - bonnet) / 2
    window = (cabin, width - 0.16, height - belt)
    rows = (
        (paint, (length - 0.1, width, belt - 0.3), (0, 0, (belt + 0.3) / 2)),
        (colors.TYRE, (length - 0.2, width - 0.1, 0.2), (0, 0, 0.28)),
        (colors.WINDOW_GLASS, window, (x, 0, (height + belt) / 2 - 0.03)),
        (paint, (cabin - 0.5, width - 0.2, 0.06), (x, 0, height - 0.03)),
    )

    axles_m = (0.31 * length, -0.30 * length)
    return _vehicle(CAR, (length, width), rows, axles_m, 0.64, 0.75 * belt)


def truck(rng: Rng) -> tuple[Solid, ...]:
    """A delivery lorry of 7 to 9 m with a cab and a box for the cargo."""
    length, width, height = rng.uniform(7.0, 9.0), 2.4, rng.uniform(3.0, 3.5)
    cab_paint, cargo_paint = rng.choice(colors.TRUCK_PAINT, 2)

    cab = 1.9
    front, cargo = length / 2 - cab / 2, length - cab - 0.15
    back = -length / 2 + cargo / 2
    rows = (
        (cab_paint, (cab, width - 0.1, 1.9), (front, 0, 1.5)),
        (colors.WINDOW_GLASS, (cab - 0.3, width - 0.06, 0.7), (front + 0.17, 0, 2.0)),
        (cargo_paint, (cargo, width, height - 1.0), (back, 0, (height + 1.0) / 2)),
        (colors.TYRE, (length - 0.6, 1.2, 0.45), (0, 0, 0.78)),
    )

    # Two axles under the cargo: the rear one carries most of it.
    axles_m = (front - 0.1, back, back - 0.3 * cargo)
    return _vehicle(LARGE_VEHICLE, (length, width), rows, axles_m, 0.95, 1.0)


def bus(rng: Rng) -> tuple[Solid, ...]:
    """A city bus of 10 to 12 m with a band of windows and a unit on the roof."""
    length, width, height = rng.uniform(10.0, 12.0), 2.5, 3.1
    paint = rng.choice(colors.BUS_PAINT)

    rows = (
        (paint, (length - 0.08, width, height - 0.35), (0, 0, (height + 0.35) / 2)),
        (colors.WINDOW_GLASS, (length - 0.02, width + 0.04, 1.0), (0, 0, 1.95)),
        (colors.SIGN_WHITE, (length - 0.4, width + 0.02, 0.18), (0, 0, 1.1)),
        (colors.METAL[3], (2.4, 1.5, 0.25), (-0.2 * length, 0, 3.2)),
    )

    axles_m = (0.31 * length, -0.27 * length)
    return _vehicle(LARGE_VEHICLE, (length, width), rows, axles_m, 0.95, 0.7)


# ------------------------------------------------------------------------------------- people


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


def bicycle(rng: Rng) -> tuple[Solid, ...]:
    """A bicycle of about 1.75 m with its rider."""
    paint = rng.choice(colors.CAR_PAINT)

    # The tubes of the frame run between these joints.
    crank, seat, bars = (0.0, 0, 0.32), (-0.12, 0, 0.88), (0.42, 0, 0.92)
    rear, front = (-0.53, 0, 0.34), (0.53, 0, 0.34)
    tubes = ((crank, seat), (seat, bars), (crank, bars), (crank, rear), (front, bars))

    return (
        _wheel(VRU, rear[0], 0, 0.68, 0.05),
        _wheel(VRU, front[0], 0, 0.68, 0.05),
        *beams(VRU, paint, 0.05, tubes),
        beam(VRU, colors.METAL[0], 0.04, (bars[0], -0.28, 1.0), (bars[0], 0.28, 1.0)),
        *_rider(rng, seat_m=0.95, lean_m=0.16),
    )


def motorcycle(rng: Rng) -> tuple[Solid, ...]:
    """A motorcycle or scooter of about 2.1 m with its rider."""
    paint = rng.choice(colors.CAR_PAINT)

    return (
        _wheel(VRU, -0.72, 0, 0.62, 0.16),
        _wheel(VRU, 0.72, 0, 0.62, 0.14),
        box(VRU, colors.METAL[0], (0.7, 0.32, 0.4), (0.0, 0, 0.45)),
        part("ellipsoid", VRU, paint, (0.7, 0.36, 0.34), (0.22, 0, 0.8)),
        box(VRU, colors.TYRE, (0.8, 0.3, 0.12), (-0.35, 0, 0.76)),
        box(VRU, paint, (0.35, 0.26, 0.2), (-0.8, 0, 0.74)),
        beam(VRU, colors.METAL[2], 0.12, (0.72, 0, 0.31), (0.45, 0, 1.0)),
        beam(VRU, colors.METAL[0], 0.05, (0.42, -0.36, 1.02), (0.42, 0.36, 1.02)),
        box(VRU, colors.HEADLIGHT, (0.1, 0.2, 0.16), (0.62, 0, 0.88)),
        *_rider(rng, seat_m=0.82, lean_m=0.1),
    )


# What moves, by the types of `ontology.ACTOR_TYPES`.
ACTORS: dict[str, Callable[[Rng], tuple[Solid, ...]]] = {
    "car": car,
    "truck": truck,
    "bus": bus,
    "pedestrian": pedestrian,
    "bicycle": bicycle,
    "motorcycle": motorcycle,
}
