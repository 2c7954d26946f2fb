"""What actors cover of the ground: rectangles that turn, and how far things are from them."""

import numpy as np
from jaxtyping import Bool, Float

Angles = Float[np.ndarray, "*t"]
Places = Float[np.ndarray, "t 3"]
# The middle of a rectangle, the direction of its length, and its length and width.
Footprint = tuple[Float[np.ndarray, "*t 2"], Angles, tuple[float, float]]


def boxes_overlap(one: Footprint, other: Footprint) -> Bool[np.ndarray, "*t"]:
    """Returns whether two rectangles overlap: no side of either parts them."""
    (center_a_m, yaw_a_rad, size_a_m), (center_b_m, yaw_b_rad, size_b_m) = one, other
    offset_m = center_b_m - center_a_m
    turned_rad = yaw_b_rad - yaw_a_rad
    cos, sin = np.abs(np.cos(turned_rad)), np.abs(np.sin(turned_rad))
    overlap = np.ones(np.shape(turned_rad), dtype=bool)

    # Along the two axes of each rectangle, half of both shadows must reach from middle to middle.
    pairs = ((yaw_a_rad, size_a_m, size_b_m), (yaw_b_rad, size_b_m, size_a_m))
    for yaw_rad, own_m, other_m in pairs:
        x, y = np.cos(yaw_rad), np.sin(yaw_rad)
        along_m = np.abs(x * offset_m[..., 0] + y * offset_m[..., 1])
        across_m = np.abs(-y * offset_m[..., 0] + x * offset_m[..., 1])
        overlap &= along_m <= (own_m[0] + other_m[0] * cos + other_m[1] * sin) / 2
        overlap &= across_m <= (own_m[1] + other_m[0] * sin + other_m[1] * cos) / 2
    return overlap


def box_distance_m(
    point_m: Places, position_m: Places, yaw_rad: Angles, size_m: tuple[float, float, float]
) -> Float[np.ndarray, "t"]:
    """Returns the distance of points from a box that stands on its position; 0 inside."""
    x, y, z = (point_m - position_m).T
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    length_m, width_m, height_m = size_m

    # How far a point is outside the box along each of the box's own axes.
    outside_m = [
        np.abs(cos * x + sin * y) - length_m / 2,
        np.abs(-sin * x + cos * y) - width_m / 2,
        np.abs(z - height_m / 2) - height_m / 2,
    ]
    return np.linalg.norm(np.maximum(outside_m, 0), axis=0)
