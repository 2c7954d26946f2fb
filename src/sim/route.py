"""The way that something takes through a town: a chain of paths, drawn as one smooth curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.lib.stride_tricks import sliding_window_view

from .layout import Path

SHARPEST_TURN_RAD = 2.2
"""Between two paths; what turns back more than this is not a way to go on."""


def gaussian_window(std: float) -> Float[np.ndarray, "2*r+1"]:
    """A Gaussian of ``std`` samples, cut off at four of them, that sums to 1."""
    reach = int(np.ceil(4 * std))
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(std, 1e-9)) ** 2)
    return window / window.sum()


def smoothed(
    values: Float[np.ndarray, "n k"], window: Float[np.ndarray, "w"]
) -> Float[np.ndarray, "n-w+1 k"]:
    """Every column averaged under the window, where the window fits."""
    return np.stack([np.convolve(column, window, mode="valid") for column in values.T], axis=1)


def slow_wave(
    rng: np.random.Generator, at: Float[np.ndarray, "n"], periods: tuple[float, float]
) -> Float[np.ndarray, "n"]:
    """A smooth random function within [-1, 1]: three sinusoids with periods in that range."""
    period = rng.uniform(*periods, size=(3, 1))
    phase = rng.uniform(0, 2 * np.pi, size=(3, 1))
    share = rng.dirichlet(np.ones(3))
    return share @ np.sin(2 * np.pi * at / period + phase)


def chain(
    paths: Sequence[Path], rng: np.random.Generator, first: int, length_m: float
) -> tuple[int, ...]:
    """Paths from ``first`` on, each a random successor of the last, at least ``length_m`` long.

    It is shorter where it ends in a path from which nothing goes on but a turn back.
    """
    indices, total_m = [first], paths[first].length_m
    while total_m < length_m:
        last = paths[indices[-1]]
        onward = [i for i in last.successors if _turn_rad(last, paths[i]) < SHARPEST_TURN_RAD]
        if not onward:
            break
        indices.append(int(rng.choice(onward)))
        total_m += paths[indices[-1]].length_m
    return tuple(indices)


def _turn_rad(before: Path, after: Path) -> float:
    into, out_of = np.diff(before.points_m[-2:], axis=0)[0], np.diff(after.points_m[:2], axis=0)[0]
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
    def through(
        cls, paths: Sequence[Path], indices: Sequence[int], corner_m: float, spacing_m: float = 0.25
    ) -> "Route":
        """The chained paths with rounded corners; the arc is measured along the paths themselves.

        ``corner_m`` is the standard deviation of the Gaussian that rounds them. It cuts a right
        angle by 0.56 of it, and the tightest radius of the cut is 0.89 of it.
        """
        chained = tuple(paths[i] for i in indices)
        points_m, _ = resample(np.concatenate([path.points_m for path in chained]), spacing_m)
        window = gaussian_window(corner_m / spacing_m)
        reach = len(window) // 2
        step_start, step_end = points_m[1] - points_m[0], points_m[-1] - points_m[-2]
        beyond = np.arange(1, reach + 1)[:, None]
        extended = [
            points_m[0] - beyond[::-1] * step_start,
            points_m,
            points_m[-1] + beyond * step_end,
        ]
        along_m = np.arange(len(points_m)) * spacing_m
        under = _under(chained, along_m)
        sides_m = np.array([(path.half_width_m, path.rise_m) for path in chained])[under]
        sides_m = np.pad(sides_m, ((2 * reach, 2 * reach), (0, 0)), mode="edge")
        # The mean of what is least within the window is nowhere more than the value itself.
        least_m = sliding_window_view(sides_m[:, 0], len(window)).min(axis=1)
        values = np.c_[
            along_m, smoothed(np.c_[least_m, sides_m[reach : len(sides_m) - reach, 1]], window)
        ]
        return cls.sampled(chained, smoothed(np.concatenate(extended), window), values, spacing_m)

    @classmethod
    def sampled(
        cls,
        paths: tuple[Path, ...],
        points_m: Float[np.ndarray, "n 2"],
        values: Float[np.ndarray, "n 3"],
        spacing_m: float,
    ) -> "Route":
        """The curve through these points; ``values`` are its ``along_m``, half width and rise."""
        steps = np.gradient(points_m, axis=0)
        heading_rad = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        return cls(spacing_m, paths, points_m, heading_rad, *values.T)

    @property
    def speed_mps(self) -> Float[np.ndarray, "n"]:
        """That of the path underneath."""
        speeds_mps = np.array([path.speed_mps for path in self.paths])
        return speeds_mps[_under(self.paths, self.along_m)]

    def arc_of(self, along_m: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t"]:
        """Where on this curve one is that far along the chained paths; held at its ends."""
        return np.interp(along_m, self.along_m, self.arc_m)

    def shifted(self, left_m: Float[np.ndarray, "n"]) -> "Route":
        """The curve ``left_m`` to the left of this one, its arc now its own true length."""
        rows = np.c_[self._beside(left_m), self.along_m, self.half_width_m, self.rise_m]
        return Route.sampled(self.paths, *resample(rows, self.spacing_m), self.spacing_m)

    def _beside(self, left_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
        normal = np.stack([-np.sin(self.heading_rad), np.cos(self.heading_rad)], axis=1)
        return self.points_m + normal * np.asarray(left_m)[:, None]

    @property
    def arc_m(self) -> Float[np.ndarray, "n"]:
        return np.arange(len(self.points_m)) * self.spacing_m

    @property
    def length_m(self) -> float:
        return (len(self.points_m) - 1) * self.spacing_m

    def at(
        self, arc_m: Float[np.ndarray, "*t"]
    ) -> tuple[Float[np.ndarray, "*t 2"], Float[np.ndarray, "*t"]]:
        """Position and heading at places along the curve; held at its ends."""
        x, y, heading_rad = (
            np.interp(arc_m, self.arc_m, column) for column in (*self.points_m.T, self.heading_rad)
        )
        return np.stack([x, y], axis=-1), heading_rad

    def sharpness(self) -> Float[np.ndarray, "n"]:
        """Unsigned change of heading per metre of arc, on the sharper side of each sample."""
        steps = np.abs(np.diff(self.heading_rad)) / self.spacing_m
        return np.maximum(np.r_[0, steps], np.r_[steps, 0])


def braked(limit_mps: Float[np.ndarray, "n"], spacing_m: float, brake_mps2: float) -> np.ndarray:
    """The speed limits along an arc, lowered so that each is met by braking no harder than that."""
    lowered = limit_mps.copy()
    for i in range(len(lowered) - 2, -1, -1):
        lowered[i] = min(lowered[i], np.sqrt(lowered[i + 1] ** 2 + 2 * brake_mps2 * spacing_m))
    return lowered


def resample(
    rows: Float[np.ndarray, "n k+2"], spacing_m: float
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m k"]]:
    """A polyline (x, y and k values a row) sampled every ``spacing_m`` of its length."""
    steps_m = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    rows = rows[np.r_[True, steps_m > 1e-9]]
    arc_m = np.r_[0.0, np.cumsum(steps_m[steps_m > 1e-9])]
    at_m = np.arange(0.0, arc_m[-1], spacing_m)
    columns = np.stack([np.interp(at_m, arc_m, column) for column in rows.T], axis=1)
    return columns[:, :2], columns[:, 2:]


def _under(paths: Sequence[Path], along_m: Float[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """Which of the chained paths lies under each place."""
    ends_m = np.cumsum([path.length_m for path in paths])
    return np.minimum(np.searchsorted(ends_m, along_m, side="right"), len(paths) - 1)
