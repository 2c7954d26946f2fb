"""Rays against triangles through Embree: what the LiDARs and the flight's altimeter see."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int


class RayScene:
    """Triangles that rays can hit; ``triangles_m`` is [f, 3, 3] in the world frame."""

    def __init__(self, triangles_m: Float[np.ndarray, "f 3 3"]) -> None:
        self._scene = EmbreeScene()
        self._count = len(triangles_m)
        if self._count:
            TriangleMesh(self._scene, np.ascontiguousarray(triangles_m, dtype=np.float32))

    def cast(
        self, origins_m: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Distance in metres (inf where nothing is hit) and index of the triangle hit (-1).

        Directions are unit vectors.
        """
        if not self._count:
            return np.full(len(origins_m), np.inf, np.float32), np.full(len(origins_m), -1)
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
        """Whether each ray hits anything at all, which is found sooner than what it hits first."""
        if not self._count or not len(origins_m):
            return np.zeros(len(origins_m), dtype=bool)
        met = self._scene.run(
            np.ascontiguousarray(origins_m, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="OCCLUDED",
        )
        return met >= 0
