"""Polylines in the plane: length, points along them, parallels and turns."""

import numpy as np
from jaxtyping import Float

Polyline = Float[np.ndarray, "n 2"]


def arc_m(points_m: Polyline) -> Float[np.ndarray, "n"]:
    """Distance along the line from its start to each corner."""
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])


def point_at(points_m: Polyline, along_m: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k 2"]:
    """The points at given distances from the start."""
    run_m = arc_m(points_m)
    return np.stack([np.interp(along_m, run_m, points_m[:, k]) for k in range(2)], axis=-1)


def heading_at(points_m: Polyline, along_m: float) -> float:
    """Direction of travel (rad) on the segment at a distance from the start."""
    run_m = arc_m(points_m)
    k = int(np.clip(np.searchsorted(run_m, along_m, side="right") - 1, 0, len(points_m) - 2))
    dx, dy = points_m[k + 1] - points_m[k]
    return float(np.arctan2(dy, dx))


def trimmed(points_m: Polyline, start_m: float, end_m: float) -> Polyline:
    """The line without its first ``start_m`` and last ``end_m``."""
    run_m = arc_m(points_m)
    low, high = start_m, run_m[-1] - end_m
    inner = points_m[(run_m > low + 1e-6) & (run_m < high - 1e-6)]
    ends = point_at(points_m, np.array([low, high]))
    return np.concatenate([ends[:1], inner, ends[1:]])


def parallel(points_m: Polyline, left_m: float) -> Polyline:
    """The line shifted to its left (to its right where negative), with mitred corners."""
    steps = np.diff(points_m, axis=0)
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sums = np.concatenate([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    # The mitre of two unit normals is their sum over 1 + their cosine, which is half its square.
    scale = 2 / (sums**2).sum(axis=1, keepdims=True)
    scale[[0, -1]] = 1
    return points_m + left_m * sums * scale


def turn(
    start_m: Float[np.ndarray, "2"],
    corner_m: Float[np.ndarray, "2"],
    end_m: Float[np.ndarray, "2"],
    corners: int = 7,
) -> Polyline:
    """A quadratic Bezier curve that leaves towards a corner and arrives from it."""
    t = np.linspace(0, 1, corners)[:, None]
    return (1 - t) ** 2 * start_m + 2 * t * (1 - t) * corner_m + t**2 * end_m
