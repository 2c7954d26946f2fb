"""Vehicles in the actor frame: x forward, y left, z up, origin on the ground under the middle."""

import numpy as np

from ...ontology import CAR, LARGE_VEHICLE
from .. import textures as colours
from ..solid import Solid
from .parts import part

# length, width, height, bonnet and boot as fractions of the length (sedan, hatch, estate, SUV).
_CAR_SHAPES = (
    (4.7, 1.82, 1.45, 0.27, 0.17),
    (4.25, 1.80, 1.50, 0.25, 0.03),
    (4.85, 1.84, 1.50, 0.26, 0.03),
    (4.75, 1.92, 1.72, 0.25, 0.03),
)


def _wheels(class_id: int, xs_m: list[float], width_m: float, diameter_m: float) -> list[Solid]:
    return [
        _wheel(class_id, x, side * (width_m / 2 - 0.13), diameter_m)
        for x in xs_m
        for side in (-1, 1)
    ]


def _wheel(class_id: int, x_m: float, y_m: float, diameter_m: float) -> Solid:
    size_m, centre_m = (diameter_m, diameter_m, 0.25), (x_m, y_m, diameter_m / 2)
    return part("cylinder", class_id, colours.TYRE, size_m, centre_m, np.pi / 2, np.pi / 2)


def _lights(class_id: int, length_m: float, width_m: float, height_m: float) -> list[Solid]:
    """Lamps that stand out of the front and the back by a centimetre."""
    return [
        part(
            "box",
            class_id,
            colours.HEADLIGHT if end > 0 else colours.TAIL_LIGHT,
            (0.06, 0.32, 0.16),
            (end * (length_m / 2 - 0.02), side * (width_m / 2 - 0.25), height_m),
        )
        for end in (1, -1)
        for side in (1, -1)
    ]


def car(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A sedan, hatchback, estate or sport utility vehicle of 4.2 to 4.9 m."""
    length, width, height, bonnet, boot = _CAR_SHAPES[rng.integers(len(_CAR_SHAPES))]
    paint = str(rng.choice(colours.CAR_PAINT))
    belt = 0.58 * height
    cabin = length * (1 - bonnet - boot)
    middle = length * (boot - bonnet) / 2
    solids = [
        part("box", CAR, paint, (length - 0.1, width, belt - 0.3), (0, 0, (belt + 0.3) / 2)),
        part("box", CAR, colours.TYRE, (length - 0.2, width - 0.1, 0.2), (0, 0, 0.28)),
        part(
            "box",
            CAR,
            colours.WINDOW_GLASS,
            (cabin, width - 0.16, height - belt),
            (middle, 0, (height + belt) / 2 - 0.03),
        ),
        part("box", CAR, paint, (cabin - 0.5, width - 0.2, 0.06), (middle, 0, height - 0.03)),
    ]
    solids += _wheels(CAR, [0.31 * length, -0.30 * length], width, 0.64)
    return tuple(solids + _lights(CAR, length, width, 0.75 * belt))


def truck(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A delivery lorry of 7 to 9 m with a cab and a box body."""
    length, width, height = rng.uniform(7.0, 9.0), 2.4, rng.uniform(3.0, 3.5)
    cab = 1.9
    paint, body = rng.choice(colours.TRUCK_PAINT, 2)
    front, cargo = length / 2 - cab / 2, length - cab - 0.15
    back = -length / 2 + cargo / 2
    solids = [
        part("box", LARGE_VEHICLE, str(paint), (cab, width - 0.1, 1.9), (front, 0, 1.5)),
        part(
            "box",
            LARGE_VEHICLE,
            colours.WINDOW_GLASS,
            (cab - 0.3, width - 0.06, 0.7),
            (front + 0.17, 0, 2.0),
        ),
        part(
            "box",
            LARGE_VEHICLE,
            str(body),
            (cargo, width, height - 1.0),
            (back, 0, (height + 1.0) / 2),
        ),
        part("box", LARGE_VEHICLE, colours.TYRE, (length - 0.6, 1.2, 0.45), (0, 0, 0.78)),
    ]
    solids += _wheels(LARGE_VEHICLE, [front - 0.1, back, back - 0.3 * cargo], width, 0.95)
    return tuple(solids + _lights(LARGE_VEHICLE, length, width, 1.0))


def bus(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A city bus of 10 to 12 m with a band of windows and a unit on the roof."""
    length, width, height = rng.uniform(10.0, 12.0), 2.5, 3.1
    paint = str(rng.choice(colours.BUS_PAINT))
    solids = [
        part(
            "box",
            LARGE_VEHICLE,
            paint,
            (length - 0.08, width, height - 0.35),
            (0, 0, (height + 0.35) / 2),
        ),
        part(
            "box",
            LARGE_VEHICLE,
            colours.WINDOW_GLASS,
            (length - 0.02, width + 0.04, 1.0),
            (0, 0, 1.95),
        ),
        part(
            "box",
            LARGE_VEHICLE,
            colours.SIGN_WHITE,
            (length - 0.4, width + 0.02, 0.18),
            (0, 0, 1.1),
        ),
        part("box", LARGE_VEHICLE, colours.METAL[3], (2.4, 1.5, 0.25), (-0.2 * length, 0, 3.2)),
    ]
    solids += _wheels(LARGE_VEHICLE, [0.31 * length, -0.27 * length], width, 0.95)
    return tuple(solids + _lights(LARGE_VEHICLE, length, width, 0.7))
