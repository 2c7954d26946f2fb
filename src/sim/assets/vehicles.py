"""Vehicles in the actor frame: x forward, y left, z up, origin on the ground under the middle."""

from collections.abc import Sequence

import numpy as np

from ...ontology import CAR, LARGE_VEHICLE
from .. import textures as colors
from ..solid import Rng, Solid
from .parts import Vector, boxes, part

# Length, width, height, and bonnet and boot as fractions of the length.
_CAR_SHAPES = (
    (4.7, 1.82, 1.45, 0.27, 0.17),  # a sedan
    (4.25, 1.80, 1.50, 0.25, 0.03),  # a hatchback
    (4.85, 1.84, 1.50, 0.26, 0.03),  # an estate
    (4.75, 1.92, 1.72, 0.25, 0.03),  # a sport utility vehicle
)


def _vehicle(
    class_id: int,
    size_m: Vector,
    rows: Sequence[tuple],
    axles_m: Vector,
    wheel_m: float,
    lamps_m: float,
) -> tuple[Solid, ...]:
    """Boxes on wheels with lamps; ``axles_m`` are places along x, ``lamps_m`` is a height."""
    length, width = size_m
    wheels = [
        part(
            "cylinder",
            class_id,
            colors.TYRE,
            (wheel_m, wheel_m, 0.25),
            (x, side * (width / 2 - 0.13), wheel_m / 2),
            np.pi / 2,
            np.pi / 2,
        )
        for x in axles_m
        for side in (-1, 1)
    ]

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
    windscreen = (cab - 0.3, width - 0.06, 0.7)
    rows = (
        (cab_paint, (cab, width - 0.1, 1.9), (front, 0, 1.5)),
        (colors.WINDOW_GLASS, windscreen, (front + 0.17, 0, 2.0)),
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
