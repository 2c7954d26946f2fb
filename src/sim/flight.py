"""One flight of the UAV through a town: the paper's App. A.1, as plain data."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import pandas as pd
from jaxtyping import Float

from ..data.clip import CLIP_SECONDS, FRAME_COLUMNS
from ..data.rates import frames_per_clip
from ..errors import UserError
from ..geometry import quat_from_euler, rigid, rotation_from_quat
from .attitude_dynamics import (
    Angles,
    Vectors,
    body_rates,
    manoeuvre_attitude,
    ornstein_uhlenbeck,
    soft_limit,
)
from .clearance import RayCast, obstacle_heights, stays_clear
from .layout import HeightField, Town
from .pilot import STEP_HZ, STEP_S, Command, FlightConfig, Pilot
from .route import Route, chain, gaussian_window, slow_wave, smoothed
from .solid import Rng

# Distance between the samples of a route.
SPACING_M = 0.5


@dataclass(frozen=True)
class Flight:
    """States at every step, ``STEP_HZ`` of them a second, whatever the capture rate.

    Position and velocity are in the world, rates in the body; ``altitude_m`` is above the terrain.
    The angles are those of the quaternion, yaw within +-pi.
    """

    time_s: Float[np.ndarray, "t"]
    position_m: Vectors
    quat_xyzw: Float[np.ndarray, "t 4"]
    velocity_mps: Vectors
    body_rates_radps: Vectors
    roll_rad: Angles
    pitch_rad: Angles
    yaw_rad: Angles
    altitude_m: Float[np.ndarray, "t"]

    @cached_property
    def world_from_body(self) -> Float[np.ndarray, "t 4 4"]:
        """The transform at every step (float64)."""
        return rigid(rotation_from_quat(self.quat_xyzw), self.position_m)

    def table(self, capture_hz: float) -> pd.DataFrame:
        """Returns the captured steps as the rows of ``frames.csv``."""
        frame = np.arange(frames_per_clip(capture_hz))
        steps = np.round(frame * STEP_HZ / capture_hz).astype(int)
        # The states have the order of the file's columns.
        states = np.column_stack([getattr(self, field.name) for field in fields(self)])
        table = pd.DataFrame(states[steps], columns=FRAME_COLUMNS[1:])
        table.insert(0, "frame", frame)
        return table


def fly(town: Town, rng: Rng, ray_cast: RayCast, config: FlightConfig) -> Flight:
    """Returns a flight along the town's corridors that touches nothing.

    Routes are drawn until one can be flown. Raises `UserError` when ``config.tries`` were in vain.
    """
    for _ in range(config.tries):
        drawn = _draw_route(town, rng, config)
        if drawn is None:
            continue

        route, start_m, cruise_mps = drawn
        obstacle_m = obstacle_heights(route, town.terrain, ray_cast, config.tube_m)
        pilot = Pilot(route, obstacle_m, rng, config, cruise_mps, CLIP_SECONDS)
        flight = _flown(route, pilot.fly_from(start_m), town.terrain, rng, config)

        # The pilot is careful, but only the track that was truly flown tells that it is clear.
        speed_mps = np.linalg.norm(flight.velocity_mps, axis=1).mean()
        fast = speed_mps >= config.slowest_mps
        if fast and stays_clear(flight.position_m, ray_cast, config.touch_m):
            return flight

    raise UserError(
        f"town {town.name}: none of {config.tries} routes could be flown; it needs corridors of "
        f"{config.cruise_mps[0] * CLIP_SECONDS:.0f} m and more that are free below "
        f"{config.ceiling_m} m"
    )


# -------------------------------------------------------------------------------------- the route


def _draw_route(town: Town, rng: Rng, config: FlightConfig) -> tuple[Route, float, float] | None:
    """Draws a curve along some corridors, where on it to start, and the cruise speed.

    Returns None where the curve is too short for the flight.
    """
    cruise_mps = rng.uniform(*config.cruise_mps)
    lengths_m = np.array([path.length_m for path in town.corridors])
    first = int(rng.choice(len(lengths_m), p=lengths_m / lengths_m.sum()))
    start_m = rng.uniform(0, lengths_m[first])
    needed_m = 1.1 * cruise_mps * (CLIP_SECONDS + 2) + config.standoff_m

    # The UAV sways within its corridor, and never leaves it by more than the tube allows.
    corridors = chain(town.corridors, rng, first, start_m + needed_m)
    middle = Route.through(corridors, config.corner_m, SPACING_M)
    room_m = np.maximum(middle.half_width_m - config.tube_m, 0)
    route = middle.shifted(room_m * slow_wave(rng, middle.arc_m, (30.0, 120.0)))
    start_m = min(start_m, route.length_m - needed_m)
    return (route, start_m, cruise_mps) if start_m >= 0 else None


# ------------------------------------------------------------------------------------- the flight


def _flown(
    route: Route, command: Command, terrain: HeightField, rng: Rng, config: FlightConfig
) -> Flight:
    """Returns the flight of an airframe that follows a command smoothly.

    It is smooth, so that it has an attitude at every step. A weighted mean over time keeps every
    bound on speed, climb and descent.
    """
    arc_m, altitude_m = command
    points_m, heading_rad = route.at(arc_m)
    window = gaussian_window(config.response_s / STEP_S)
    track = smoothed(np.c_[points_m, altitude_m, heading_rad], window)
    position_m = track[:, :3].copy()
    position_m[:, 2] += terrain(track[:, 0], track[:, 1])

    velocity_mps = (position_m[2:] - position_m[:-2]) / (2 * STEP_S)
    acceleration_mps2 = (position_m[2:] - 2 * position_m[1:-1] + position_m[:-2]) / STEP_S**2
    yaw_rad = track[1:-1, 3]
    roll_rad, pitch_rad = _attitude(velocity_mps, acceleration_mps2, yaw_rad, rng, config)
    angles = (roll_rad, pitch_rad, np.append(yaw_rad, 2 * yaw_rad[-1] - yaw_rad[-2]))
    quat_xyzw = quat_from_euler(*angles)

    return Flight(
        time_s=np.arange(len(yaw_rad)) * STEP_S,
        position_m=position_m[1:-1],
        quat_xyzw=quat_xyzw[:-1],
        velocity_mps=velocity_mps,
        body_rates_radps=body_rates(quat_xyzw, STEP_S),
        roll_rad=roll_rad[:-1],
        pitch_rad=pitch_rad[:-1],
        yaw_rad=(yaw_rad + np.pi) % (2 * np.pi) - np.pi,
        altitude_m=track[1:-1, 2],
    )


def _attitude(
    velocity_mps: Vectors,
    acceleration_mps2: Vectors,
    yaw_rad: Angles,
    rng: Rng,
    config: FlightConfig,
) -> list[Float[np.ndarray, "t+1"]]:
    """Returns roll and pitch: those of the motion and of gusts, below the limit.

    They are one more than there are steps, for the last body rate.
    """
    motion = manoeuvre_attitude(velocity_mps, acceleration_mps2, yaw_rad, config.drag_per_s)
    longer = [np.append(angle_rad, angle_rad[-1]) for angle_rad in motion]
    gusty = [angle_rad + _gust(rng, len(angle_rad), config) for angle_rad in longer]
    return [soft_limit(angle_rad, config.tilt_limit_rad) for angle_rad in gusty]


def _gust(rng: Rng, steps: int, config: FlightConfig) -> Angles:
    """Draws the paper's Ornstein-Uhlenbeck angle, with which the UAV holds its track in gusts."""
    window = gaussian_window(config.gust_response_s / STEP_S)
    eta_rad = ornstein_uhlenbeck(
        rng, steps + len(window) - 1, STEP_S, config.gust_kappa_per_s, config.gust_sigma_rad
    )
    return smoothed(eta_rad[:, None], window)[:, 0]
