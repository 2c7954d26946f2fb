"""Parked vehicles: in bays along kerbs, on drives before houses, and in rows on lots.

They are the moving actors' own shapes, with their classes, but part of the town. A site refuses
them where they would stand in a lane, on a walking line or under a corridor.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..assets import ACTORS, extent_m
from ..assets.parts import upright
from ..layout import GroundPatch
from ..solid import Solid
from .network import PAVEMENT_RISE_M, Street
from .site import Site
from .streetscape import spots

TRUCK_SHARE = 0.08
BAY_RISE_M = PAVEMENT_RISE_M + 0.04
"""Of the bays cut into a pavement: level with it but for what keeps the two surfaces apart."""
DRIVE_M = (5.6, 3.0)
DRIVE_RISE_M = 0.08
BAY_M = {"car": (5.2, 2.6), "truck": (10.4, 3.8)}
"""Length and width of a bay on a lot."""
AISLE_M = {"car": 6.0, "truck": 9.0}
LOT_RISE_M, LINE_RISE_M, LINE_M = 0.08, 0.12, 0.14


def parked(rng: np.random.Generator, truck_share: float = TRUCK_SHARE) -> list[Solid]:
    """A car or a truck that nobody drives, along +x."""
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
    """Vehicles in bays along the kerbs of a street, headed as its traffic; ``share`` of the places
    that are not in anybody's way are taken. A way without pavements has no bays."""
    line, profile = site.network.open_m(street), street.profile
    if not profile.pavement_m:
        return
    for side in sides:
        for spot in spots(line, side * profile.road_m / 2, spacing_m, rng, jitter=0.1):
            vehicle = parked(rng)
            if rng.random() >= share:
                continue
            length_m, width_m, _ = extent_m(vehicle)
            # Traffic keeps to the right: it has the middle of the road on its left.
            heading = spot.yaw_rad - np.pi / 2
            # The lane comes close to the road's edge, so the bay is all in the pavement.
            x = float(spot.x_m - width_m / 2 * np.cos(spot.yaw_rad))
            y = float(spot.y_m - width_m / 2 * np.sin(spot.yaw_rad))
            if site.place(vehicle, x, y, heading, BAY_RISE_M):
                bay_m = (length_m + 0.8, width_m)
                patch = GroundPatch((x, y), heading, *bay_m, BAY_RISE_M, "asphalt")
                site.ground.append(patch)


def drives(site: Site, street: Street, rng: np.random.Generator, spacing_m: float) -> None:
    """Cars on paved drives behind the pavements of a street."""
    for side in (-1, 1):
        out_m = side * (street.profile.half_m + DRIVE_M[0] / 2)
        for spot in spots(site.network.open_m(street), out_m, spacing_m, rng):
            heading = spot.yaw_rad + rng.choice([0.0, np.pi])
            car = list(ACTORS["car"](rng))
            if site.place(car, spot.x_m, spot.y_m, heading, DRIVE_RISE_M):
                middle_m = (spot.x_m, spot.y_m)
                site.ground.append(
                    GroundPatch(middle_m, heading, *DRIVE_M, DRIVE_RISE_M, "concrete")
                )


def lot(
    site: Site,
    middle_m: tuple[float, float],
    yaw_rad: float,
    rng: np.random.Generator,
    columns: int,
    share: float,
    kind: Literal["car", "truck"] = "car",
) -> None:
    """A paved rectangle with two rows of marked bays and an aisle between them, along
    ``yaw_rad``; ``share`` of the bays are taken."""
    bay_length_m, bay_width_m = BAY_M[kind]
    length_m, depth_m = columns * bay_width_m, 2 * bay_length_m + AISLE_M[kind]
    frame = upright(*middle_m, 0.0, yaw_rad)

    def lay(along_m: float, across_m: float, size_m: tuple[float, float], *surface) -> None:
        x, y = (frame @ (along_m, across_m, 0.0, 1.0))[:2]
        site.ground.append(GroundPatch((float(x), float(y)), yaw_rad, *size_m, *surface))

    lay(0.0, 0.0, (length_m, depth_m), LOT_RISE_M, "asphalt")
    for side in (-1, 1):
        across_m = side * (depth_m - bay_length_m) / 2
        for k in range(columns + 1):
            edge_m = k * bay_width_m - length_m / 2
            lay(edge_m, across_m, (LINE_M, bay_length_m), LINE_RISE_M, "kerb")
            if k == columns:
                continue
            vehicle = list(ACTORS[kind](rng))
            heading = yaw_rad + rng.choice([-1, 1]) * np.pi / 2 + rng.normal(0, 0.03)
            if rng.random() < share:
                x, y = (frame @ (edge_m + bay_width_m / 2, across_m, 0.0, 1.0))[:2]
                site.place(vehicle, float(x), float(y), heading, LOT_RISE_M)
