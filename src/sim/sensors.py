"""The two LiDARs that serve the annotation only: one above and one below the body (Sec. 3.2)."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..geometry import rotate
from .rays import spread_directions
from .scene import ScanHits, Scene

# Multiples of the two numbers of the R2 sequence, taken modulo 1, fill the unit square evenly.
SHIFT_PER_SCAN, TURN_PER_SCAN = 0.7548776662466927, 0.5698402909980532


@dataclass(frozen=True)
class Lidar:
    """A sensor fixed to the body, with axes parallel to it.

    It scans the directions whose sine of elevation lies in ``sin_elevation``, evenly over the
    sphere; each scan is turned against the one before, so that scans fill each other's gaps.
    """

    name: str
    position_m: tuple[float, float, float]
    sin_elevation: tuple[float, float]

    def directions(self, rays: int, scan: int) -> Float[np.ndarray, "n 3"]:
        """Returns unit vectors in the body frame: a Fibonacci lattice, turned for each scan."""
        turn_rad = 2 * math.pi * (scan * TURN_PER_SCAN % 1)
        return spread_directions(rays, self.sin_elevation, scan * SHIFT_PER_SCAN % 1, turn_rad)


# Either is blind where the body hides the other's side; together they see every direction.
LIDARS = (
    Lidar("lidar_top", position_m=(0.0, 0.0, 0.15), sin_elevation=(-0.6, 1.0)),
    Lidar("lidar_bottom", position_m=(0.0, 0.0, -0.15), sin_elevation=(-1.0, 0.6)),
)


@dataclass(frozen=True)
class Scan:
    """One scan in the world frame: where it was taken, its unit directions, and what they met."""

    origin_m: Float[np.ndarray, "3"]
    directions: Float[np.ndarray, "n 3"]
    hits: ScanHits

    def points_m(self, hit: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "k 3"]:
        """Returns the places where these rays ended; they must have met something."""
        return self.origin_m + self.directions[hit] * self.hits.distance_m[hit, None]


def scan(
    scene: Scene,
    step: int,
    world_from_body: Float[np.ndarray, "4 4"],
    rays: int,
    index: int,
    range_m: float,
) -> list[Scan]:
    """Takes one scan with each LiDAR of the scene as it is at a step.

    ``rays`` is each one's number of rays, ``index`` the number of the scan in its clip. Returns
    beyond the range count as none.
    """
    rotation, position_m = world_from_body[:3, :3], world_from_body[:3, 3]
    directions = [rotate(world_from_body, lidar.directions(rays, index)) for lidar in LIDARS]
    origins_m = [rotation @ np.array(lidar.position_m) + position_m for lidar in LIDARS]

    # Both are cast together, so that the moving actors are put into place once.
    hits = scene.cast(step, np.repeat(origins_m, rays, axis=0), np.concatenate(directions))
    hits = hits.within(range_m)
    return [
        Scan(origins_m[k], directions[k], hits.part(slice(k * rays, (k + 1) * rays)))
        for k in range(len(LIDARS))
    ]
