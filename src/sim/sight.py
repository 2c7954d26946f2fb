"""What is in an actor's way: the kernel that looks along every route at all other actors."""

import numpy as np
from jaxtyping import Float, Int

from ..jit import njit

Numbers = Float[np.ndarray, "n"]
Indices = Int[np.ndarray, "n"]

# How far actors look ahead, and the spacing of the places on their own way at which they look.
SIGHT_M = 30.0
LOOK_M = 1.0


@njit
def look_ahead(
    points_m: Float[np.ndarray, "n s 2"],
    heading_rad: Float[np.ndarray, "n s"],
    here: Indices,
    bumper: Indices,
    stride: int,
    size_m: Float[np.ndarray, "n 2"],
    side_gap_m: Numbers,
    speed_mps: Numbers,
) -> tuple[Numbers, Numbers]:
    """Returns the distance from each front to the first in its way, and that one's speed along it.

    Routes are samples; ``here`` and ``bumper`` are the indices under each middle and front, and
    every ``stride``-th sample is looked at. An actor that is looked at is three discs as wide as it
    is, along its length. The distance is inf where none is in the way within `SIGHT_M`.
    """
    count = len(here)
    gap_m, lead_mps = np.full(count, np.inf), np.zeros(count)
    for own in range(count):
        x, y = points_m[own, here[own]]
        ahead_x, ahead_y = np.cos(heading_rad[own, here[own]]), np.sin(heading_rad[own, here[own]])
        for other in range(count):
            # Most pairs are far apart, or one is behind: they are told apart first.
            dx, dy = points_m[other, here[other]] - points_m[own, here[own]]
            half_m = (size_m[own, 0] + size_m[other, 0]) / 2
            behind = dx * ahead_x + dy * ahead_y < -half_m
            if other == own or behind or np.hypot(dx, dy) > SIGHT_M + half_m:
                continue

            other_rad = heading_rad[other, here[other]]
            clear_m = (size_m[own, 1] + size_m[other, 1]) / 2
            clear_m += max(side_gap_m[own], side_gap_m[other])
            reach_m = max(size_m[other, 0] - size_m[other, 1], 0.0) / 2
            for disc in (-1.0, 0.0, 1.0):
                disc_x = x + dx + disc * reach_m * np.cos(other_rad)
                disc_y = y + dy + disc * reach_m * np.sin(other_rad)
                at, along_m, side_m = _beside(
                    points_m[own], heading_rad[own], bumper[own], stride, disc_x, disc_y
                )
                free_m = along_m - size_m[other, 1] / 2
                if 0 < along_m < SIGHT_M and abs(side_m) < clear_m and free_m < gap_m[own]:
                    gap_m[own] = free_m
                    lead_mps[own] = speed_mps[other] * np.cos(other_rad - heading_rad[own, at])
    return gap_m, lead_mps


@njit
def _beside(points_m, heading_rad, first, stride, x_m, y_m):
    """Returns a way's sample nearest to a point, and how far ahead and aside of it that is."""
    nearest, least_m2, steps = first, np.inf, 0
    for k in range(int(SIGHT_M / LOOK_M)):
        at = min(first + k * stride, len(points_m) - 1)
        apart_m2 = (points_m[at, 0] - x_m) ** 2 + (points_m[at, 1] - y_m) ** 2
        if apart_m2 < least_m2:
            nearest, least_m2, steps = at, apart_m2, k

    # Ahead is counted along the way, and the rest is measured in the frame of that sample.
    dx, dy = x_m - points_m[nearest, 0], y_m - points_m[nearest, 1]
    cos, sin = np.cos(heading_rad[nearest]), np.sin(heading_rad[nearest])
    return nearest, steps * LOOK_M + dx * cos + dy * sin, -dx * sin + dy * cos
