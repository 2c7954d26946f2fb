"""Small steps that every asset is made with: parts, beams, placing and measuring.

An asset is a list of solids in its own frame, z up, standing on z = 0. Things beside a street look
along +x (towards the road); actors travel along +x.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..solid import Shape, Solid

Vector = Sequence[float]
Ends = tuple[Vector, Vector]
Rows = Iterable[tuple]

# How deep things reach into the ground, so that neither a slope nor a kerb opens a gap.
ROOT_M = -0.2


def upright(
    x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0
) -> Float[np.ndarray, "4 4"]:
    """Returns the transform ``scene_from_asset`` of an upright asset."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0, x_m], [sin, cos, 0, y_m], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


def part(
    shape: Shape,
    class_id: int,
    material: str,
    size_m: Vector,
    center_m: Vector,
    yaw_rad: float = 0.0,
    tilt_rad: float = 0.0,
) -> Solid:
    """A solid by the middle of its extent; ``tilt_rad`` turns it about its own y before the yaw."""
    scene_from_solid = upright(*center_m, yaw_rad)
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)
    scene_from_solid[:3, :3] @= np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])

    # A generator's draws are numpy's numbers and strings; a solid is plain data.
    size_m = tuple(float(side_m) for side_m in size_m)
    return Solid(shape, class_id, size_m, scene_from_solid, str(material))


def box(class_id: int, material: str, size_m: Vector, center_m: Vector, *turn_rad: float) -> Solid:
    """A box by its middle; ``turn_rad`` is its yaw, then its tilt, as of `part`."""
    return part("box", class_id, material, size_m, center_m, *turn_rad)


def boxes(class_id: int, rows: Rows) -> list[Solid]:
    """Boxes of one class; each row holds material, size, center, and any turn."""
    return [box(class_id, *row) for row in rows]


def beam(class_id: int, material: str, thickness_m: float, start_m: Vector, end_m: Vector) -> Solid:
    """A thin cylinder from one point to another."""
    start, end = np.asarray(start_m, dtype=float), np.asarray(end_m, dtype=float)
    length_m = float(np.linalg.norm(end - start))
    along = (end - start) / length_m

    # Any axis that is not parallel to the beam gives the directions across it.
    helper = np.array([1.0, 0, 0]) if abs(along[2]) > 0.9 else np.array([0, 0, 1.0])
    across = np.cross(helper, along)
    across /= np.linalg.norm(across)

    scene_from_solid = np.eye(4)
    scene_from_solid[:3, :3] = np.stack([across, np.cross(along, across), along], axis=1)
    scene_from_solid[:3, 3] = (start + end) / 2
    size_m = (thickness_m, thickness_m, length_m)
    return Solid("cylinder", class_id, size_m, scene_from_solid, str(material))


def beams(class_id: int, material: str, thickness_m: float, ends: Iterable[Ends]) -> list[Solid]:
    """Thin cylinders of one class, material and thickness, each from point to point."""
    return [beam(class_id, material, thickness_m, *pair) for pair in ends]


def posts(
    class_id: int, material: str, thickness_m: float, feet_m: Iterable[Vector], top_m: float
) -> list[Solid]:
    """Upright cylinders from below the ground to one height, at places (x, y)."""
    ends = [((x, y, ROOT_M), (x, y, top_m)) for x, y in feet_m]
    return beams(class_id, material, thickness_m, ends)


def placed(solids: Sequence[Solid], world_from_asset: Float[np.ndarray, "4 4"]) -> list[Solid]:
    """Returns the asset, given in its own frame, in the world."""
    return [replace(s, scene_from_solid=world_from_asset @ s.scene_from_solid) for s in solids]


def bounds_m(solid: Solid) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lower and upper corner of the tight axis-aligned box around a solid, in its scene's frame."""
    columns = solid.scene_from_solid[:3, :3] * (np.asarray(solid.size_m) / 2)
    center = solid.scene_from_solid[:3, 3]
    # Half the extent of the solid's elliptic section, along each axis of the scene.
    disc = np.hypot(columns[:, 0], columns[:, 1])

    if solid.shape == "cone":
        base, tip = center - columns[:, 2], center + columns[:, 2]
        return np.minimum(base - disc, tip), np.maximum(base + disc, tip)
    if solid.shape == "box":
        half = np.abs(columns).sum(axis=1)
    elif solid.shape == "ellipsoid":
        half = np.linalg.norm(columns, axis=1)
    else:
        half = disc + np.abs(columns[:, 2])
    return center - half, center + half


def extent_m(solids: Sequence[Solid]) -> tuple[float, float, float]:
    """Length, width and height of the axis-aligned box around an actor, in the actor's frame."""
    lower, upper = (np.stack(corners) for corners in zip(*map(bounds_m, solids)))
    length, width, height = upper.max(axis=0) - lower.min(axis=0)
    return float(length), float(width), float(height)
