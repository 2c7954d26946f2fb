"""Parked vehicles: along kerbs, half on the pavement, and in rows on lots."""

from collections.abc import Sequence

import numpy as np

from ..assets import ACTORS, extent_m
from ..assets.parts import pose
from ..layout import GroundPatch
from ..solid import Solid
from .network import PAVEMENT_RISE_M, ROAD_RISE_M, Street
from .site import Site
from .streetscape import spots

BAY_M = (5.2, 2.6)
TRUCK_SHARE = 0.08
ON_ROAD_M = 0.0
"""How much of a car stands on the road, the rest on the pavement."""


def parked(rng: np.random.Generator, truck_share: float = TRUCK_SHARE) -> list[Solid]:
    """A car or a truck that nobody drives: the moving actors' own shapes, along +x."""
    kind = "truck" if rng.random() < truck_share else "car"
    return list(ACTORS[kind](rng))


def park(
    site: Site,
    street: Street,
    rng: np.random.Generator,
    share: float,
    spacing_m: float = 6.6,
    sides: Sequence[int] = (-1, 1),
) -> None:
    """Vehicles along the kerbs of a street, headed as its traffic; ``share`` of the places that
    are not in anybody's way are taken."""
    line, profile = site.network.open_m(street), street.profile
    for side in sides:
        for spot in spots(line, side * profile.road_m / 2, spacing_m, rng, jitter=0.1):
            vehicle = parked(rng)
            if rng.random() >= share:
                continue
            # Traffic keeps to the right, so whoever stands on the left is headed back.
            heading = spot.yaw_rad + np.pi / 2
            out_m = extent_m(vehicle)[1] / 2 - ON_ROAD_M
            x = spot.x_m - out_m * np.cos(spot.yaw_rad)
            y = spot.y_m - out_m * np.sin(spot.yaw_rad)
            rise_m = PAVEMENT_RISE_M if profile.pavement_m else ROAD_RISE_M
            site.place(vehicle, float(x), float(y), heading, rise_m)


def lot(
    site: Site,
    middle_m: tuple[float, float],
    yaw_rad: float,
    rng: np.random.Generator,
    columns: int,
    share: float,
    truck_share: float = TRUCK_SHARE,
) -> None:
    """A paved rectangle with two rows of bays and a lane between them."""
    length_m, depth_m = columns * BAY_M[1], 2 * BAY_M[0] + 6.0
    site.ground.append(GroundPatch(middle_m, yaw_rad, length_m, depth_m, 0.1, "asphalt"))
    frame = pose(*middle_m, 0.0, yaw_rad)
    for column in range(columns):
        for side in (-1, 1):
            vehicle = parked(rng, truck_share)
            if rng.random() >= share:
                continue
            across_m = side * (depth_m / 2 - BAY_M[0] / 2)
            along_m = (column + 0.5) * BAY_M[1] - length_m / 2
            x, y = (frame @ np.array([along_m, across_m, 0, 1]))[:2]
            heading = yaw_rad + side * np.pi / 2 + rng.normal(0, 0.03)
            site.place(vehicle, float(x), float(y), heading, 0.1)
