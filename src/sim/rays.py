"""Rays against triangles through Embree: what the LiDARs and the flight's altimeter see."""

import math

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

Points = Float[np.ndarray, "n 3"]

GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))


def spread_directions(
    count: int, sin_elevation: tuple[float, float], shift: float = 0.5, turn_rad: float = 0.0
) -> Points:
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
    """Triangles that rays can hit; ``triangles_m`` is [f, 3, 3] in the world frame.

    Rays begin at origins in metres; their directions are unit vectors.
    """

    def __init__(self, triangles_m: Float[np.ndarray, "f 3 3"]) -> None:
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(triangles_m, dtype=np.float32))

    def cast(
        self, origins_m: Points, directions: Points
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Returns distances in metres (inf where nothing is hit) and indices of triangles (-1)."""
        hits = self._scene.run(*_for_embree(origins_m, directions), output=True)
        face = hits["primID"]
        return np.where(face >= 0, hits["tfar"], np.float32(np.inf)), face

    def blocked(self, origins_m: Points, directions: Points) -> Bool[np.ndarray, "n"]:
        """Returns which rays hit anything; that takes less time than what each hits first."""
        return self._scene.run(*_for_embree(origins_m, directions), query="OCCLUDED") >= 0


def _for_embree(*arrays: Points) -> list[Points]:
    return [np.ascontiguousarray(array, dtype=np.float32) for array in arrays]
