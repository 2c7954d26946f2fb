"""Small steps that every asset is made with: parts, beams, placing and measuring.

An asset is a list of solids in its own frame, z up, standing on z = 0. Things beside a street look
along +x (towards the road); actors travel along +x.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..solid import Shape, Solid

Vector = Sequence[float]

ROOT_M = -0.2
"""How deep things reach into the ground, so that neither a slope nor a kerb opens a gap."""


def pose(
    x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0
) -> Float[np.ndarray, "4 4"]:
    """``scene_from_asset`` of an upright asset."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0, x_m], [sin, cos, 0, y_m], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


def part(
    shape: Shape,
    class_id: int,
    material: str,
    size_m: Vector,
    centre_m: Vector,
    yaw_rad: float = 0.0,
    tilt_rad: float = 0.0,
) -> Solid:
    """A solid by the middle of its extent; ``tilt_rad`` turns it about its own y before the yaw."""
    scene_from_solid = pose(*centre_m, yaw_rad)
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)
    scene_from_solid[:3, :3] @= np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return Solid(shape, class_id, tuple(float(s) for s in size_m), scene_from_solid, material)


def beam(class_id: int, material: str, start_m: Vector, end_m: Vector, thickness_m: float) -> Solid:
    """A thin cylinder from one point to another."""
    start, end = np.asarray(start_m, dtype=float), np.asarray(end_m, dtype=float)
    length_m = float(np.linalg.norm(end - start))
    along = (end - start) / length_m
    helper = np.array([1.0, 0, 0]) if abs(along[2]) > 0.9 else np.array([0, 0, 1.0])
    across = np.cross(helper, along)
    across /= np.linalg.norm(across)
    scene_from_solid = np.eye(4)
    scene_from_solid[:3, :3] = np.stack([across, np.cross(along, across), along], axis=1)
    scene_from_solid[:3, 3] = (start + end) / 2
    return Solid(
        "cylinder", class_id, (thickness_m, thickness_m, length_m), scene_from_solid, material
    )


def placed(solids: Sequence[Solid], world_from_asset: Float[np.ndarray, "4 4"]) -> list[Solid]:
    """The asset, given in its own frame, in the world."""
    return [replace(s, scene_from_solid=world_from_asset @ s.scene_from_solid) for s in solids]


def bounds_m(solid: Solid) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lower and upper corner of the tight axis-aligned box around a solid, in its scene's frame."""
    columns = solid.scene_from_solid[:3, :3] * (np.asarray(solid.size_m) / 2)
    centre = solid.scene_from_solid[:3, 3]
    disc = np.hypot(columns[:, 0], columns[:, 1])
    if solid.shape == "box":
        half = np.abs(columns).sum(axis=1)
    elif solid.shape == "ellipsoid":
        half = np.linalg.norm(columns, axis=1)
    elif solid.shape == "cylinder":
        half = disc + np.abs(columns[:, 2])
    else:
        base, tip = centre - columns[:, 2], centre + columns[:, 2]
        return np.minimum(base - disc, tip), np.maximum(base + disc, tip)
    return centre - half, centre + half


def extent_m(solids: Sequence[Solid]) -> tuple[float, float, float]:
    """Length, width and height of the axis-aligned box around an actor, in the actor's frame."""
    lower, upper = (np.stack(corners) for corners in zip(*map(bounds_m, solids)))
    length, width, height = upper.max(axis=0) - lower.min(axis=0)
    return float(length), float(width), float(height)
