"""What the UAV's rays tell about the room around a route: obstacle heights, and touches."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .layout import HeightField
from .rays import spread_directions
from .route import Route

Points = Float[np.ndarray, "n 3"]
Values = Float[np.ndarray, "n"]

# Distance in metres from each origin along its unit direction; inf where nothing is hit.
RayCast = Callable[[Points, Points], Values]

# Height above the ground from which rays look down.
TOP_M = 19.5

# Spacing of the rays that look for wires: these are 3 to 5 cm thick.
COMB_M = 0.03

# Higher than anything in a town.
SKY_M = 300.0


def obstacle_heights(
    route: Route, terrain: HeightField, ray_cast: RayCast, tube_m: float
) -> Values:
    """Returns the height above the ground of what stands within ``tube_m`` of each sample.

    Two combs of downward rays, dense along the route and dense across it, find the tops of all that
    is lower than 19.5 m, however thin. A fan of level rays from each sample to the next finds what
    is taller, whose top such a ray starts below. This is the paper's h_obs before its look-ahead.
    """
    tops_m = _tops(route, terrain, ray_cast, tube_m)
    return np.maximum(tops_m, _walls(route, terrain, ray_cast, tube_m))


def _tops(route: Route, terrain: HeightField, ray_cast: RayCast, tube_m: float) -> Values:
    """Returns the highest top that the rays down around each sample meet; 0 where none is met."""
    along = np.arange(0, route.spacing_m, COMB_M)
    across = np.arange(-tube_m, tube_m + COMB_M, COMB_M)
    lines = np.linspace(-tube_m, tube_m, 5)
    lengthwise = np.stack(np.meshgrid(along, lines), axis=-1).reshape(-1, 2)
    comb = np.concatenate([lengthwise, np.stack([np.zeros_like(across), across], axis=-1)])

    forward = np.stack([np.cos(route.heading_rad), np.sin(route.heading_rad)], axis=1)[:, None]
    left = forward[..., ::-1] * np.array([-1.0, 1.0])
    points_m = route.points_m[:, None] + comb[:, :1] * forward + comb[:, 1:] * left
    origins_m = _above(points_m.reshape(-1, 2), terrain, TOP_M)
    tops_m = TOP_M - ray_cast(origins_m, np.broadcast_to([0.0, 0.0, -1.0], origins_m.shape))
    return np.maximum(tops_m.reshape(len(route.points_m), -1).max(axis=1), 0.0)


def _walls(route: Route, terrain: HeightField, ray_cast: RayCast, tube_m: float) -> Values:
    """Returns how high the highest level ray is that meets something before the next sample."""
    heights_m = np.append(np.arange(2.0, TOP_M, 1.0), TOP_M)
    normal = np.stack([-np.sin(route.heading_rad), np.cos(route.heading_rad)], axis=1)
    highest_m = np.zeros(len(route.points_m))

    for side_m in (-tube_m, 0.0, tube_m):
        points_m = route.points_m + side_m * normal
        origins_m = np.stack([_above(points_m, terrain, h_m) for h_m in heights_m], axis=1)
        steps = np.diff(origins_m, axis=0)
        lengths_m = np.maximum(np.linalg.norm(steps, axis=-1), 1e-9)
        directions = (steps / lengths_m[..., None]).reshape(-1, 3)
        reach_m = ray_cast(origins_m[:-1].reshape(-1, 3), directions)
        hit = reach_m.reshape(lengths_m.shape) <= lengths_m
        highest_m[:-1] = np.maximum(highest_m[:-1], np.where(hit, heights_m, 0).max(axis=1))
    return highest_m


def _above(points_m: Float[np.ndarray, "n 2"], terrain: HeightField, height_m: float) -> Points:
    return np.c_[points_m, terrain(points_m[:, 0], points_m[:, 1]) + height_m]


def stays_clear(position_m: Points, ray_cast: RayCast, clearance_m: float) -> bool:
    """Returns whether a track is outside all geometry and keeps that distance from it.

    It is outside when the sky is open above its first point and it crosses no surface afterwards;
    it keeps its distance when at every point rays in many directions all reach further.
    """
    upright = np.array([[0.0, 0.0, 1.0]])
    if ray_cast(position_m[:1], upright)[0] < SKY_M:
        return False

    # A step of no length has no direction, and crosses nothing.
    steps = np.diff(position_m, axis=0)
    lengths_m = np.linalg.norm(steps, axis=1)
    moved = lengths_m > 1e-9
    directions = steps[moved] / lengths_m[moved, None]
    if (ray_cast(position_m[:-1][moved], directions) <= lengths_m[moved]).any():
        return False
    return bool(_nearest_m(position_m, ray_cast).min() >= clearance_m)


def _nearest_m(position_m: Points, ray_cast: RayCast, count: int = 128) -> Values:
    """Returns the distance to the nearest surface in any of ``count`` directions, evenly spread."""
    directions = np.tile(spread_directions(count, (1.0, -1.0)), (len(position_m), 1))
    reach_m = ray_cast(np.repeat(position_m, count, axis=0), directions)
    return reach_m.reshape(len(position_m), count).min(axis=1)
