"""A flight log: attitude, height and, if there is any, motion of a UAV, from a CSV of one's own."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from ..errors import UserError, reason_of, way_out_of
from ..geometry import quat_from_euler, rigid, rotation_from_quat
from ..limits import require_choice
from ..terminal import say

ALIASES = {"time": "time_s", "altitude_m": "height_m"}
QUAT, ANGLES = ("qx", "qy", "qz", "qw"), ("roll", "pitch", "yaw")
VELOCITY, PLACE = ("vx_mps", "vy_mps", "vz_mps"), ("x_m", "y_m")
IMAGE = "image"
# North, east, down and forward, right, down, in our axes; a half turn about x, its own inverse.
FLIPS = {"enu": (1.0, 1.0, 1.0), "ned": (1.0, -1.0, -1.0)}
# What two clocks, or a CSV's last digits, may be apart; a longer time without a pose is told.
CLOCK_S, GAP_S = 1e-6, 0.5
# Of poses that are farther apart the clock is in doubt.
SLOWEST_S = 2.0
LENGTH_TOLERANCE = 0.01
# A velocity is that of so much time before and after.
MEAN_S = 0.1
Array = np.ndarray


@dataclass(frozen=True)
class FlightLog:
    """Poses of a body at ascending times. ``height_m`` is above the ground.

    ``place_m`` (x, y) and ``velocity_mps`` are in the world frame; without either, nothing is known
    of the motion. ``images`` are names of files, empty where there is none. ``motion`` says in
    words where they come from.
    """

    path: Path
    time_s: Float[Array, "n"]
    quat_xyzw: Float[Array, "n 4"]
    height_m: Float[Array, "n"]
    place_m: Float[Array, "n 2"] | None
    velocity_mps: Float[Array, "n 3"] | None
    motion: str
    images: Sequence[str]

    @classmethod
    def read(cls, path: Path, convention: str = "enu") -> "FlightLog":
        """Reads a CSV, and prints what is odd in it but no mistake.

        ``convention`` "ned" is for a world of north, east, down and a body of forward, right, down.
        Raises `UserError` for missing columns, for what is no number, and for times, angles and
        quaternions that cannot be.
        """
        require_choice("task.poses_convention", convention, FLIPS)
        table = _in_order(_numbers(_columns(path), path), path)
        flip = np.array(FLIPS[convention])
        time_s = table["time_s"].to_numpy(np.float64)
        quat_xyzw = _attitude(table, path) * [*flip, 1]
        place_m, velocity_mps = (
            table[[*names]].to_numpy(np.float64) * flip[: len(names)]
            if _has(table, names, path)
            else None
            for names in (PLACE, VELOCITY)
        )

        motion = "positions and velocities are the file's"
        if place_m is None and velocity_mps is None:
            motion = "neither positions nor velocities are given"
        elif velocity_mps is None:
            motion = "velocities are the derivative of the positions"
        elif place_m is None:
            motion = "positions are the integral of the velocities"
            means_mps = (velocity_mps[1:, :2] + velocity_mps[:-1, :2]) / 2
            steps_m = means_mps * np.diff(time_s)[:, None]
            place_m = np.concatenate([np.zeros((1, 2)), steps_m.cumsum(axis=0)])

        images = [*table[IMAGE]] if IMAGE in table else []
        height_m = table["height_m"].to_numpy(np.float64)
        return cls(path, time_s, quat_xyzw, height_m, place_m, velocity_mps, motion, images)

    def named_images(self) -> dict[str, float]:
        """Returns the times of the images that the log names, by name, in order. Raises `UserError`
        for a name that is there twice."""
        names = [name for name in self.images if name]
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise UserError(f"poses: {self.path}: image {twice[0]} is there twice; name it once")
        return {name: time for name, time in zip(self.images, self.time_s) if name}

    def require_span(self, times_s: Float[Array, "t"], of: str) -> None:
        """Raises `UserError` for a time without poses before and after."""
        first_s, last_s = self.time_s[0], self.time_s[-1]
        if times_s[0] < first_s - CLOCK_S or times_s[-1] > last_s + CLOCK_S:
            raise UserError(
                f"video: {of} has images from {times_s[0]:.3f} to {times_s[-1]:.3f} s, and "
                f"{self.path} poses from {first_s:.3f} to {last_s:.3f} s; give task.start_s, the "
                "first image's time by the poses' clock (of a folder, with task.rate_hz), and "
                "task.seconds, if poses end early"
            )

    def poses_at(self, times_s: Float[Array, "t"]) -> Float[Array, "t 4 4"]:
        """Returns ``world_from_body`` between the poses; x and y are 0 if no motion is known."""
        after = np.searchsorted(self.time_s, times_s).clip(1, len(self.time_s) - 1)
        start_s, end_s = self.time_s[after - 1], self.time_s[after]
        share = ((times_s - start_s) / (end_s - start_s)).clip(0, 1)
        quat = _slerp(self.quat_xyzw[after - 1], self.quat_xyzw[after], share)
        return rigid(rotation_from_quat(quat), self._position_m(times_s))

    def velocities_at(self, times_s: Float[Array, "t"]) -> Float[Array, "t 3"] | None:
        """Returns velocities in the world frame; `None` where no motion is known."""
        if self.velocity_mps is not None:
            return _interpolated(times_s, self.time_s, self.velocity_mps)
        if self.place_m is None:
            return None
        ends_s = (times_s + sign * MEAN_S for sign in (-1, 1))
        start_s, end_s = (each.clip(self.time_s[0], self.time_s[-1]) for each in ends_s)
        moved_m = self._position_m(end_s) - self._position_m(start_s)
        return moved_m / (end_s - start_s)[:, None]

    def _position_m(self, times_s: Float[Array, "t"]) -> Float[Array, "t 3"]:
        place_m = np.zeros((len(self.time_s), 2)) if self.place_m is None else self.place_m
        return _interpolated(times_s, self.time_s, np.column_stack([place_m, self.height_m]))


def _interpolated(
    times_s: Float[Array, "t"], known_s: Float[Array, "n"], values: Float[Array, "n c"]
) -> Float[Array, "t c"]:
    return np.stack([np.interp(times_s, known_s, column) for column in values.T], axis=-1)


def _slerp(
    start: Float[Array, "t 4"], end: Float[Array, "t 4"], share: Float[Array, "t"]
) -> Float[Array, "t 4"]:
    """Returns unit quaternions at a share of the shorter way from one to another."""
    cosine = (start * end).sum(axis=-1, keepdims=True)
    angle_rad = np.arccos(np.abs(cosine).clip(0, 1))
    # Of a small angle the sine is the angle, and the way a straight line.
    is_small = angle_rad < 1e-6
    sine = np.sin(np.where(is_small, 1, angle_rad))
    of_start, of_end = (
        np.where(is_small, each, np.sin(each * angle_rad) / sine)
        for each in (1 - share[:, None], share[:, None])
    )
    return of_start * start + of_end * np.where(cosine < 0, -end, end)


def _columns(path: Path) -> pd.DataFrame:
    """Reads a table whose columns have the names of this file. Raises `UserError` for a file that
    is none, and names all columns that are missing at once."""
    try:
        # A comma, a semicolon or a tab: the first line tells.
        how = {"skipinitialspace": True, "skip_blank_lines": False, "index_col": False}
        table = pd.read_csv(path, dtype={IMAGE: str}, **how).dropna(how="all")
    except (OSError, ValueError) as error:
        way_out = way_out_of(error, "give a CSV", path)
        raise UserError(f"poses: {path} cannot be read ({reason_of(error)}); {way_out}") from error
    table.columns = [name.strip() for name in table.columns]
    table = table.rename(columns={a: b for a, b in ALIASES.items() if b not in table})

    lacks = []
    if "time_s" not in table:
        lacks.append("time_s (or time)")
    if "height_m" not in table:
        lacks.append("height_m (or altitude_m), above the ground")
    if not {*QUAT} <= {*table.columns}:
        lacks += [
            f"{angle}_rad (or {angle}_deg, or qx, qy, qz, qw)"
            for angle in ANGLES
            if not {f"{angle}_rad", f"{angle}_deg"} & {*table.columns}
        ]
    if lacks:
        between = "; separate columns by commas" if ";" in table.columns[0] else ""
        raise UserError(f"poses: {path} lacks {'; '.join(lacks)}{between}")
    return table


def _has(table: pd.DataFrame, names: Sequence[str], path: Path) -> bool:
    """Tells whether all of some columns are there. Raises `UserError` where only some are."""
    lacking = [name for name in names if name not in table]
    if 0 < len(lacking) < len(names):
        raise UserError(f"poses: {path} lacks {', '.join(lacking)}; give all of {', '.join(names)}")
    return not lacking


def _numbers(table: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Returns the columns that are used. Raises `UserError` for a cell that is no number."""
    angles = [f"{angle}_{unit}" for angle in ANGLES for unit in ("rad", "deg")]
    used = [
        name for name in ("time_s", "height_m", *QUAT, *angles, *PLACE, *VELOCITY) if name in table
    ]

    numbers = table[used].apply(pd.to_numeric, errors="coerce")
    bad = ~np.isfinite(numbers.to_numpy(np.float64))
    if bad.any():
        row, column = np.argwhere(bad)[0]
        said = table[used].iloc[row, column]
        raise UserError(
            f"poses: {path}, line {table.index[row] + 2}: {used[column]} is {said!s}; give a "
            "number, or delete the line"
        )
    return numbers.assign(image=table[IMAGE].fillna("")) if IMAGE in table else numbers


def _in_order(table: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Leaves out what is there twice, and tells of gaps. Raises `UserError` for times that go back
    and for two poses at one time."""
    steps_s = np.diff(table["time_s"])
    if (steps_s < 0).any():
        line = table.index[int(np.argmax(steps_s < 0)) + 1] + 2
        raise UserError(f"poses: {path}, line {line}: time_s goes back; sort the lines by time")

    once = table.drop_duplicates()
    if (twice := once["time_s"].duplicated()).any():
        line = int(np.argmax(twice))
        raise UserError(
            f"poses: {path}, line {once.index[line] + 2}: another pose at a time_s that is there "
            "already; keep one of the two"
        )

    if len(table) > len(once):
        say(f"{path}: {len(table) - len(once)} lines are there twice and count once")
    if len(once) < 2:
        raise UserError(f"poses: {path} has {len(once)} poses; give two or more")

    gaps_s = np.diff(once["time_s"])
    if (step_s := float(np.median(gaps_s))) > SLOWEST_S:
        raise UserError(
            f"poses: {path}: most poses are {step_s:g} s apart; is time_s in seconds? Give a pose "
            f"every {SLOWEST_S:g} s or more often"
        )
    if (gaps_s > GAP_S).any():
        at_s = once["time_s"].iloc[int(np.argmax(gaps_s))]
        say(
            f"{path}: {int((gaps_s > GAP_S).sum())} gaps of more than {GAP_S:g} s, of up to "
            f"{gaps_s.max():.2f} s after {at_s:g} s: poses there are guesses"
        )
    return once


def _attitude(table: pd.DataFrame, path: Path) -> Float[Array, "n 4"]:
    """Returns unit quaternions. Raises `UserError` for others, and for angles in another unit."""
    if {*QUAT} <= {*table.columns}:
        quat = table[[*QUAT]].to_numpy(np.float64)
        length = np.linalg.norm(quat, axis=-1)
        if (wrong := abs(length - 1) > LENGTH_TOLERANCE).any():
            line = table.index[int(np.argmax(wrong))] + 2
            raise UserError(
                f"poses: {path}, line {line}: the length of qx, qy, qz, qw is "
                f"{length[wrong][0]:.3f}, and that of a rotation is 1"
            )
        return quat / length[:, None]

    rad = {}
    for angle in ANGLES:
        in_rad = f"{angle}_rad" in table
        rad[angle] = table[f"{angle}_{'rad' if in_rad else 'deg'}"].to_numpy(np.float64)
        rad[angle] = rad[angle] if in_rad else np.deg2rad(rad[angle])
        if in_rad and (largest := abs(rad[angle]).max()) > 2 * np.pi + 0.01:
            raise UserError(
                f"poses: {path}: {angle}_rad reaches {largest:.1f}; name degrees {angle}_deg"
            )
    return quat_from_euler(*rad.values())
