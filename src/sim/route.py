"""Routes through a town: chains of paths, each drawn as one smooth curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.lib.stride_tricks import sliding_window_view

from .layout import Path

# Between two paths: one that turns back more than this is not a way to go on.
SHARPEST_TURN_RAD = 2.2


def gaussian_window(std: float) -> Float[np.ndarray, "2*r+1"]:
    """Returns a Gaussian of ``std`` samples, cut off at four of them, that sums to 1."""
    reach = int(np.ceil(4 * std))
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(std, 1e-9)) ** 2)
    return window / window.sum()


def smoothed(
    values: Float[np.ndarray, "n k"], window: Float[np.ndarray, "w"]
) -> Float[np.ndarray, "n-w+1 k"]:
    """Averages every column under the window, where the window fits."""
    return np.stack([np.convolve(column, window, mode="valid") for column in values.T], axis=1)


def slow_wave(
    rng: np.random.Generator, at: Float[np.ndarray, "n"], periods: tuple[float, float]
) -> Float[np.ndarray, "n"]:
    """Draws a smooth random function within [-1, 1]: three sinusoids with periods in a range."""
    period = rng.uniform(*periods, size=(3, 1))
    phase = rng.uniform(0, 2 * np.pi, size=(3, 1))
    share = rng.dirichlet(np.ones(3))
    return share @ np.sin(2 * np.pi * at / period + phase)


def chain(
    paths: Sequence[Path], rng: np.random.Generator, first: int, length_m: float
) -> tuple[Path, ...]:
    """Draws a chain of paths from the one at index ``first`` on, each a successor of the last.

    It is at least ``length_m`` long, or ends in a path from which only a turn back goes on.
    """
    chained = [paths[first]]
    while sum(path.length_m for path in chained) < length_m:
        onward = [paths[i] for i in chained[-1].successors]
        onward = [path for path in onward if _turn_rad(chained[-1], path) < SHARPEST_TURN_RAD]
        if not onward:
            break
        chained.append(onward[rng.choice(len(onward))])

    return tuple(chained)


def _turn_rad(before: Path, after: Path) -> float:
    into = before.points_m[-1] - before.points_m[-2]
    out_of = after.points_m[1] - after.points_m[0]
    cosine = into @ out_of / (np.linalg.norm(into) * np.linalg.norm(out_of))
    return float(np.arccos(np.clip(cosine, -1, 1)))


@dataclass(frozen=True)
class Route:
    """A curve in the plane, sampled every ``spacing_m`` of its parameter, the arc.

    ``heading_rad`` is the direction of travel, continuous (not wrapped). ``along_m`` is how far
    along the chained ``paths`` each sample lies. ``half_width_m`` and ``rise_m`` pass smoothly from
    path to path; the half width is nowhere more than that of the path underneath.
    """

    spacing_m: float
    paths: tuple[Path, ...]
    points_m: Float[np.ndarray, "n 2"]
    heading_rad: Float[np.ndarray, "n"]
    along_m: Float[np.ndarray, "n"]
    half_width_m: Float[np.ndarray, "n"]
    rise_m: Float[np.ndarray, "n"]

    @classmethod
    def through(cls, paths: Sequence[Path], corner_m: float, spacing_m: float = 0.25) -> "Route":
        """Chains paths and rounds their corners; the arc is measured along the paths themselves.

        ``corner_m`` is the standard deviation of the Gaussian that rounds them. It cuts a right
        angle by 0.56 of it, and the tightest radius of the cut is 0.89 of it.
        """
        points_m = resample(np.concatenate([path.points_m for path in paths]), spacing_m)
        window = gaussian_window(corner_m / spacing_m)
        reach = len(window) // 2

        # The chain goes straight on at both ends, so that smoothing does not shorten it.
        beyond = np.arange(1, reach + 1)[:, None]
        before_m = points_m[0] - beyond[::-1] * (points_m[1] - points_m[0])
        after_m = points_m[-1] + beyond * (points_m[-1] - points_m[-2])
        extended_m = np.concatenate([before_m, points_m, after_m])

        # The mean of the least values within the window is nowhere more than the value itself.
        along_m = np.arange(len(points_m)) * spacing_m
        sides_m = np.array([(path.half_width_m, path.rise_m) for path in paths])
        sides_m = sides_m[_under(paths, along_m)]
        sides_m = np.pad(sides_m, ((2 * reach, 2 * reach), (0, 0)), mode="edge")
        least_m = sliding_window_view(sides_m[:, 0], len(window)).min(axis=1)
        sides_m = smoothed(np.c_[least_m, sides_m[reach : len(sides_m) - reach, 1]], window)
        rows_m = np.c_[smoothed(extended_m, window), along_m, sides_m]
        return cls._through_rows(tuple(paths), rows_m, spacing_m)

    @classmethod
    def _through_rows(
        cls, paths: tuple[Path, ...], rows_m: Float[np.ndarray, "n 5"], spacing_m: float
    ) -> "Route":
        """Builds a curve from samples: x, y, ``along_m``, half width and rise."""
        steps = np.gradient(rows_m[:, :2], axis=0)
        heading_rad = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        return cls(spacing_m, paths, rows_m[:, :2], heading_rad, *rows_m[:, 2:].T)

    @property
    def speed_mps(self) -> Float[np.ndarray, "n"]:
        """The speed limit of the path underneath."""
        speeds_mps = np.array([path.speed_mps for path in self.paths])
        return speeds_mps[_under(self.paths, self.along_m)]

    def arc_of(self, along_m: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t"]:
        """Returns the arcs at distances along the chained paths; held at the curve's ends."""
        return np.interp(along_m, self.along_m, self.arc_m)

    def shifted(self, left_m: Float[np.ndarray, "n"]) -> "Route":
        """Returns the curve ``left_m`` to the left of this one; its arc is its own true length."""
        normal = np.stack([-np.sin(self.heading_rad), np.cos(self.heading_rad)], axis=1)
        beside_m = self.points_m + normal * np.asarray(left_m)[:, None]
        rows_m = np.c_[beside_m, self.along_m, self.half_width_m, self.rise_m]
        return self._through_rows(self.paths, resample(rows_m, self.spacing_m), self.spacing_m)

    @property
    def arc_m(self) -> Float[np.ndarray, "n"]:
        return np.arange(len(self.points_m)) * self.spacing_m

    @property
    def length_m(self) -> float:
        return (len(self.points_m) - 1) * self.spacing_m

    def at(
        self, arc_m: Float[np.ndarray, "*t"]
    ) -> tuple[Float[np.ndarray, "*t 2"], Float[np.ndarray, "*t"]]:
        """Returns position and heading at arcs of the curve; held at its ends."""
        x, y, heading_rad = (
            np.interp(arc_m, self.arc_m, column) for column in (*self.points_m.T, self.heading_rad)
        )
        return np.stack([x, y], axis=-1), heading_rad

    def sharpness(self) -> Float[np.ndarray, "n"]:
        """Returns the unsigned change of heading per metre, on each sample's sharper side."""
        steps = np.abs(np.diff(self.heading_rad)) / self.spacing_m
        return np.maximum(np.r_[0, steps], np.r_[steps, 0])


def braked(limit_mps: Float[np.ndarray, "n"], spacing_m: float, brake_mps2: float) -> np.ndarray:
    """Lowers speed limits along an arc so that each is met by braking no harder than a limit."""
    lowered = limit_mps.copy()
    # Backwards from the end: what must be slow later limits how fast one may come to it.
    for i in range(len(lowered) - 2, -1, -1):
        lowered[i] = min(lowered[i], np.sqrt(lowered[i + 1] ** 2 + 2 * brake_mps2 * spacing_m))
    return lowered


def resample(rows: Float[np.ndarray, "n k"], spacing_m: float) -> Float[np.ndarray, "m k"]:
    """Samples a polyline (x, y and further values a row) every ``spacing_m`` of its length."""
    steps_m = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    # Paths share their ends, and a step of no length would have no direction.
    rows = rows[np.r_[True, steps_m > 1e-9]]
    arc_m = np.r_[0.0, np.cumsum(steps_m[steps_m > 1e-9])]
    at_m = np.arange(0.0, arc_m[-1], spacing_m)
    return np.stack([np.interp(at_m, arc_m, column) for column in rows.T], axis=1)


def _under(paths: Sequence[Path], along_m: Float[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """Returns the index of the chained path under each place."""
    ends_m = np.cumsum([path.length_m for path in paths])
    return np.minimum(np.searchsorted(ends_m, along_m, side="right"), len(paths) - 1)
