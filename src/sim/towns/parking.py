"""Parked vehicles: in bays along kerbs, on drives before houses, and in rows on lots.

They have the shapes and the classes of the moving actors, but are part of the town. A site refuses
them where they would stand in a lane, on a walking line or under a corridor.
"""

from typing import Literal

import numpy as np

from ..assets import ACTORS, extent_m
from .network import PAVEMENT_RISE_M, Street
from .polyline import Spot
from .streetscape import BOTH, Streetscape

TRUCK_SHARE = 0.08
# Bays are cut into a pavement: level with it but for what keeps the two surfaces apart.
BAY_RISE_M = PAVEMENT_RISE_M + 0.04
DRIVE_M = (5.6, 3.0)
DRIVE_RISE_M = 0.08
# Length and width of a bay on a lot, and the aisle between its two rows.
BAY_M = {"car": (5.2, 2.6), "truck": (10.4, 3.8)}
AISLE_M = {"car": 6.0, "truck": 9.0}
LOT_RISE_M, LINE_RISE_M, LINE_M = 0.08, 0.12, 0.14


def park(site: Streetscape, street: Street, share: float) -> None:
    """Parks vehicles in bays along the kerbs of a street, headed as its traffic.

    ``share`` of the places that are in nobody's way are taken. A way without pavements has none.
    """
    line, profile = site.network.open_m(street), street.profile
    if not profile.pavement_m:
        return

    for side in BOTH:
        for spot in site.spots(line, side * profile.road_m / 2, 6.6, jitter=0.1):
            kind = "truck" if site.rng.random() < TRUCK_SHARE else "car"
            vehicle = ACTORS[kind](site.rng)
            if site.rng.random() >= share:
                continue
            length_m, width_m, _ = extent_m(vehicle)
            # The lane comes close to the road's edge, so the bay is all in the pavement. Traffic
            # keeps to the right: it has the middle of the road on its left.
            bay = spot.moved(-width_m / 2, 0.0, -np.pi / 2)
            if site.place(vehicle, *bay, BAY_RISE_M):
                site.lay(*bay, (length_m + 0.8, width_m), BAY_RISE_M, "asphalt")


def drives(site: Streetscape, street: Street, spacing_m: float) -> None:
    """Parks cars on paved drives behind the pavements of a street."""
    for side in BOTH:
        out_m = side * (street.profile.half_m + DRIVE_M[0] / 2)
        for spot in site.spots(site.network.open_m(street), out_m, spacing_m):
            drive = spot.moved(0.0, 0.0, site.rng.choice([0.0, np.pi]))
            if site.place(ACTORS["car"](site.rng), *drive, DRIVE_RISE_M):
                site.lay(*drive, DRIVE_M, DRIVE_RISE_M, "concrete")


def lot(
    site: Streetscape, middle: Spot, columns: int, share: float, kind: Literal["car", "truck"]
) -> None:
    """Lays a paved rectangle with two rows of marked bays and an aisle between them.

    The rows run along the yaw of ``middle``; ``share`` of the bays are taken.
    """
    bay_length_m, bay_width_m = BAY_M[kind]
    length_m, depth_m = columns * bay_width_m, 2 * bay_length_m + AISLE_M[kind]
    site.lay(*middle, (length_m, depth_m), LOT_RISE_M, "asphalt")

    for side in BOTH:
        across_m = side * (depth_m - bay_length_m) / 2
        for k in range(columns + 1):
            edge_m = k * bay_width_m - length_m / 2
            line = middle.moved(edge_m, across_m)
            site.lay(*line, (LINE_M, bay_length_m), LINE_RISE_M, "kerb")
            if k == columns:
                continue

            # Drivers park forwards or backwards, and never quite straight.
            vehicle = ACTORS[kind](site.rng)
            turned_rad = site.rng.choice([-1, 1]) * np.pi / 2 + site.rng.normal(0, 0.03)
            if site.rng.random() < share:
                bay = middle.moved(edge_m + bay_width_m / 2, across_m, turned_rad)
                site.place(vehicle, *bay, LOT_RISE_M)
