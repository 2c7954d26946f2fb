"""Polylines in the plane: length, points along them, places beside them, parallels and turns."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Polyline = Float[np.ndarray, "n 2"]
Point = Float[np.ndarray, "2"]


class Spot(NamedTuple):
    """A place in the plane, and the direction in which someone who stands there looks."""

    x_m: float
    y_m: float
    yaw_rad: float

    def moved(self, ahead_m: float, left_m: float, turned_rad: float = 0.0) -> "Spot":
        """Returns the spot at an offset ahead and to the left of this one, turned by an angle."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        x = self.x_m + cos * ahead_m - sin * left_m
        y = self.y_m + sin * ahead_m + cos * left_m
        return Spot(float(x), float(y), self.yaw_rad + turned_rad)


def arc_m(points_m: Polyline) -> Float[np.ndarray, "n"]:
    """Distance along the line from its start to each corner."""
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])


def point_at(points_m: Polyline, along_m: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k 2"]:
    """Returns the points at given distances from the start."""
    run_m = arc_m(points_m)
    return np.stack([np.interp(along_m, run_m, points_m[:, k]) for k in range(2)], axis=-1)


def heading_at(points_m: Polyline, along_m: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
    """Directions of travel (rad) on the segments at given distances from the start."""
    x_m, y_m = np.diff(points_m, axis=0).T
    segment = np.searchsorted(arc_m(points_m), along_m, side="right") - 1
    return np.arctan2(y_m, x_m)[np.clip(segment, 0, len(x_m) - 1)]


def beside(points_m: Polyline, along_m: float, left_m: float) -> Spot:
    """Returns the place ``left_m`` to the left of a point of the line, looking along the line."""
    heading_rad = float(heading_at(points_m, np.array(along_m)))
    normal = np.array([-np.sin(heading_rad), np.cos(heading_rad)])
    x, y = point_at(points_m, np.array(along_m)) + left_m * normal
    return Spot(float(x), float(y), heading_rad)


def trimmed(points_m: Polyline, start_m: float, end_m: float) -> Polyline:
    """Returns the line without its first ``start_m`` and last ``end_m``."""
    run_m = arc_m(points_m)
    low, high = start_m, run_m[-1] - end_m
    inner = points_m[(run_m > low + 1e-6) & (run_m < high - 1e-6)]
    ends = point_at(points_m, np.array([low, high]))
    return np.concatenate([ends[:1], inner, ends[1:]])


def parallel(points_m: Polyline, left_m: float) -> Polyline:
    """Returns the line shifted to its left (to its right where negative), with mitred corners."""
    steps = np.diff(points_m, axis=0)
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sums = np.concatenate([normals[:1], normals[:-1] + normals[1:], normals[-1:]])

    # The mitre of two unit normals is their sum over 1 + their cosine, which is half its square.
    scale = 2 / (sums**2).sum(axis=1, keepdims=True)
    scale[[0, -1]] = 1
    return points_m + left_m * sums * scale


def turn(start_m: Point, corner_m: Point, end_m: Point, corners: int = 7) -> Polyline:
    """A quadratic Bezier curve that leaves towards a corner and arrives from it."""
    t = np.linspace(0, 1, corners)[:, None]
    return (1 - t) ** 2 * start_m + 2 * t * (1 - t) * corner_m + t**2 * end_m


def crossing(come_m: Polyline, go_m: Polyline) -> Point:
    """Returns where two lines would meet if the first were prolonged and the second began earlier.

    Only the first two points of each line count: ``come_m`` runs back along the way one comes.
    """
    a, b = come_m[0] - come_m[1], go_m[0] - go_m[1]
    gap = go_m[0] - come_m[0]
    determinant = a[0] * -b[1] + b[0] * a[1]
    # Lines that are nearly parallel meet far away, or nowhere.
    if abs(determinant) < 0.2 * np.linalg.norm(a) * np.linalg.norm(b):
        return (come_m[0] + go_m[0]) / 2

    ahead = (gap[0] * -b[1] + b[0] * gap[1]) / determinant
    return come_m[0] + max(ahead, 0.0) * a
