"""The one primitive that every scene is made of: a convex solid with a class and a material."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

Shape = Literal["box", "cylinder", "cone", "ellipsoid"]

# Every town and every asset is drawn from a generator that is passed in.
Rng = np.random.Generator


@dataclass(frozen=True)
class Solid:
    """A box, an elliptic cylinder or cone (axis along z, cone's tip up), or an ellipsoid.

    ``size_m`` is its full extent along its own x, y and z; its origin is the middle of that extent.
    ``scene_from_solid`` (4x4, float64) places it in the world, or in an actor's frame when it is a
    part of an actor. ``material`` names a texture or a plain color of `textures`. Plain data: no
    simulator is needed to build, tessellate or probe it.
    """

    shape: Shape
    class_id: int
    size_m: tuple[float, float, float]
    scene_from_solid: Float[np.ndarray, "4 4"]
    material: str

    def contains(
        self, points_scene: Float[np.ndarray, "n 3"], margin_m: float = 0.0
    ) -> Bool[np.ndarray, "n"]:
        """Returns which points lie in the solid grown by ``margin_m`` (shrunk where negative)."""
        half_m = np.asarray(self.size_m) / 2 + margin_m
        if (half_m <= 0).any():
            return np.zeros(len(points_scene), dtype=bool)

        # In units of its own half extents, every solid of a shape is the same one.
        rotation = self.scene_from_solid[:3, :3]
        unit = (points_scene - self.scene_from_solid[:3, 3]) @ rotation / half_m
        if self.shape == "box":
            return (np.abs(unit) <= 1).all(axis=1)
        if self.shape == "ellipsoid":
            return (unit**2).sum(axis=1) <= 1
        radius = 1.0 if self.shape == "cylinder" else np.clip((1 - unit[:, 2]) / 2, 0, 1)
        return (np.abs(unit[:, 2]) <= 1) & (np.hypot(unit[:, 0], unit[:, 1]) <= radius)
