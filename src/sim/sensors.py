"""The two LiDARs that serve the annotation only: one above and one below the body (Sec. 3.2)."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..ontology import UNKNOWN
from .scene import Hits, Scene

GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))


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
        """Unit vectors in the body frame: a Fibonacci lattice, turned and shifted per scan."""
        shift = (scan * 0.7548776662466927) % 1.0
        low, high = self.sin_elevation
        z = low + (high - low) * (np.arange(rays) + shift) / rays
        angle = GOLDEN_ANGLE_RAD * np.arange(rays) + 2 * math.pi * ((scan * 0.5698402909980532) % 1)
        across = np.sqrt(np.maximum(0.0, 1 - z**2))
        return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


LIDARS = (
    Lidar("lidar_top", (0.0, 0.0, 0.15), (-0.6, 1.0)),
    Lidar("lidar_bottom", (0.0, 0.0, -0.15), (-1.0, 0.6)),
)
"""Either is blind where the body hides the other's side; together they see every direction."""


@dataclass(frozen=True)
class Scan:
    """One scan in the world frame: where it was taken, its unit directions, and what they met."""

    origin_m: Float[np.ndarray, "3"]
    directions: Float[np.ndarray, "n 3"]
    hits: Hits

    def points_m(self) -> Float[np.ndarray, "n 3"]:
        """Where every ray ended; not finite where it met nothing."""
        return self.origin_m + self.directions * self.hits.distance_m[:, None]


def scan(
    scene: Scene,
    step: int,
    world_from_body: Float[np.ndarray, "4 4"],
    rays: int,
    index: int,
    range_m: float,
) -> list[Scan]:
    """One scan of each LiDAR of the scene as it is at a step.

    ``rays`` is each one's number of rays; returns beyond the range count as none. Both are cast
    together, so that the moving actors are put into place once.
    """
    rotation, place_m = world_from_body[:3, :3], world_from_body[:3, 3]
    directions = [lidar.directions(rays, index) @ rotation.T for lidar in LIDARS]
    origins_m = [rotation @ np.array(lidar.position_m) + place_m for lidar in LIDARS]
    hits = scene.cast(step, np.repeat(origins_m, rays, axis=0), np.concatenate(directions))
    far = hits.distance_m > range_m
    hits.distance_m[far] = np.inf
    hits.class_id[far] = UNKNOWN
    hits.actor_id[far] = -1
    return [
        Scan(origins_m[k], directions[k], hits.part(slice(k * rays, (k + 1) * rays)))
        for k in range(len(LIDARS))
    ]
