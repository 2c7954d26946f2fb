"""Hand-made ways, and the road users on them."""

from itertools import combinations

import numpy as np

from src.sim.actor import HABITS, Actor
from src.sim.footprint import boxes_overlap
from src.sim.layout import Path
from src.sim.route import Route

SIZES_M = {
    "car": (4.5, 1.8, 1.5),
    "truck": (8.0, 2.4, 3.0),
    "bus": (11.0, 2.5, 3.2),
    "pedestrian": (0.5, 0.6, 1.75),
    "bicycle": (1.8, 0.6, 1.7),
    "motorcycle": (2.1, 0.8, 1.5),
}


def way(*points_m, successors=(), half_width_m=1.6, speed_mps=9.0, rise_m=0.04, gate=None):
    points_m = np.array(points_m, dtype=float)
    return Path(points_m, half_width_m, speed_mps, successors, rise_m, gate)


def road_user(name, paths, start_m, speed_mps, left_m=None):
    """An actor on a chain of paths, in their middle or ``left_m`` to the left of it."""
    route = Route.through(paths, HABITS[name].corner_m)
    if left_m is not None:
        route = route.shifted(np.full(len(route.points_m), left_m))
    return Actor(name, SIZES_M[name], route, start_m, speed_mps)


def overlapping(boxes):
    """The pairs of boxes (place, yaw, size) that are in the same place at some step."""
    return [pair for pair in combinations(boxes, 2) if boxes_overlap(*pair).any()]
