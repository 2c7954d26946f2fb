"""What actors cover of the ground: rectangles that turn, and how far things are from them."""

import numpy as np
from jaxtyping import Bool, Float


def boxes_overlap(
    centre_a_m: Float[np.ndarray, "*t 2"],
    yaw_a_rad: Float[np.ndarray, "*t"],
    size_a_m: tuple[float, float],
    centre_b_m: Float[np.ndarray, "*t 2"],
    yaw_b_rad: Float[np.ndarray, "*t"],
    size_b_m: tuple[float, float],
) -> Bool[np.ndarray, "*t"]:
    """Whether two rectangles (length, width) overlap: no side of either keeps them apart."""
    offset_m = centre_b_m - centre_a_m
    turned_rad = yaw_b_rad - yaw_a_rad
    cos, sin = np.abs(np.cos(turned_rad)), np.abs(np.sin(turned_rad))
    overlap = np.ones(np.shape(turned_rad), dtype=bool)
    for yaw_rad, mine_m, yours_m in (
        (yaw_a_rad, size_a_m, size_b_m),
        (yaw_b_rad, size_b_m, size_a_m),
    ):
        x, y = np.cos(yaw_rad), np.sin(yaw_rad)
        along_m = np.abs(x * offset_m[..., 0] + y * offset_m[..., 1])
        across_m = np.abs(-y * offset_m[..., 0] + x * offset_m[..., 1])
        overlap &= along_m <= (mine_m[0] + yours_m[0] * cos + yours_m[1] * sin) / 2
        overlap &= across_m <= (mine_m[1] + yours_m[0] * sin + yours_m[1] * cos) / 2
    return overlap


def box_distance_m(
    point_m: Float[np.ndarray, "t 3"],
    position_m: Float[np.ndarray, "t 3"],
    yaw_rad: Float[np.ndarray, "t"],
    size_m: tuple[float, float, float],
) -> Float[np.ndarray, "t"]:
    """Distance of points from a box that stands on its position; 0 inside."""
    offset_m = point_m - position_m
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    length_m, width_m, height_m = size_m
    outside_m = np.stack(
        [
            np.abs(cos * offset_m[:, 0] + sin * offset_m[:, 1]) - length_m / 2,
            np.abs(-sin * offset_m[:, 0] + cos * offset_m[:, 1]) - width_m / 2,
            np.abs(offset_m[:, 2] - height_m / 2) - height_m / 2,
        ]
    )
    return np.linalg.norm(np.maximum(outside_m, 0), axis=0)
