"""Rays against triangles through Embree: what the LiDARs and the flight's altimeter see."""

import math

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))


def spread_directions(
    count: int, sin_elevation: tuple[float, float], shift: float = 0.5, turn_rad: float = 0.0
) -> Float[np.ndarray, "n 3"]:
    """Returns unit vectors, evenly over the sphere between two elevations: a Fibonacci lattice.

    ``shift``, from 0 to 1, moves the lattice up by so many of its steps, ``turn_rad`` turns it.
    """
    # Equal steps in the sine of elevation cover equal areas of the sphere.
    low, high = sin_elevation
    z = low + (high - low) * (np.arange(count) + shift) / count

    azimuth_rad = GOLDEN_ANGLE_RAD * np.arange(count) + turn_rad
    across = np.sqrt(np.maximum(0.0, 1 - z**2))
    return np.stack([across * np.cos(azimuth_rad), across * np.sin(azimuth_rad), z], axis=1)


class RayScene:
    """Triangles that rays can hit; ``triangles_m`` is [f, 3, 3] in the world frame."""

    def __init__(self, triangles_m: Float[np.ndarray, "f 3 3"]) -> None:
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(triangles_m, dtype=np.float32))

    def cast(
        self, origins_m: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Returns distances in metres (inf where nothing is hit) and indices of triangles (-1).

        Directions are unit vectors.
        """
        hits = self._scene.run(
            np.ascontiguousarray(origins_m, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            output=True,
        )
        face = hits["primID"]
        return np.where(face >= 0, hits["tfar"], np.float32(np.inf)), face

    def blocked(
        self, origins_m: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, "n"]:
        """Returns which rays hit anything; that takes less time than what each hits first."""
        met = self._scene.run(
            np.ascontiguousarray(origins_m, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="OCCLUDED",
        )
        return met >= 0
