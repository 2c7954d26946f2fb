"""Roll and pitch of the UAV: what its motion demands, and what gusts add (App. A.1).

Body axes are x forward, y left, z up, so positive pitch is nose down and positive roll right side
down. Turning left therefore banks with negative roll.
"""

import numpy as np
from jaxtyping import Float

GRAVITY_MPS2 = 9.81


def ornstein_uhlenbeck(
    rng: np.random.Generator,
    steps: int,
    step_s: float,
    kappa_per_s: float,
    sigma: float,
    mean: float = 0.0,
) -> Float[np.ndarray, "steps"]:
    """One path of the paper's ``d eta = kappa (mu - eta) dt + sigma dW``, from its steady state.

    The discretisation is exact at any step: the standard deviation is sigma / sqrt(2 kappa).
    """
    keep = np.exp(-kappa_per_s * step_s)
    steady_std = sigma / np.sqrt(2 * kappa_per_s)
    noise = rng.standard_normal(steps) * steady_std
    noise[1:] *= np.sqrt(1 - keep**2)
    path = np.empty(steps)
    state = 0.0
    for k in range(steps):
        state = keep * state + noise[k]
        path[k] = state
    return mean + path


def manoeuvre_tilt(
    velocity_mps: Float[np.ndarray, "t 3"],
    acceleration_mps2: Float[np.ndarray, "t 3"],
    yaw_rad: Float[np.ndarray, "t"],
    drag_per_s: float,
) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
    """Roll and pitch that point the thrust where the motion needs it.

    A multirotor pushes along its body z only, so that axis must lie along acceleration plus drag
    plus gravity: nose down to go forward, the inner side down in a turn.
    """
    thrust = acceleration_mps2 + drag_per_s * velocity_mps + np.array([0, 0, GRAVITY_MPS2])
    cos_yaw, sin_yaw = np.cos(yaw_rad), np.sin(yaw_rad)
    forward = cos_yaw * thrust[:, 0] + sin_yaw * thrust[:, 1]
    left = -sin_yaw * thrust[:, 0] + cos_yaw * thrust[:, 1]
    roll_rad = -np.arctan2(left, np.hypot(forward, thrust[:, 2]))
    return roll_rad, np.arctan2(forward, thrust[:, 2])


def soft_limit(
    angle_rad: Float[np.ndarray, "t"], limit_rad: float, knee: float = 2 / 3
) -> Float[np.ndarray, "t"]:
    """Angles kept below a limit: unchanged up to a knee, then bent towards it smoothly."""
    free_rad = knee * limit_rad
    room_rad = limit_rad - free_rad
    excess_rad = np.maximum(np.abs(angle_rad) - free_rad, 0)
    bent = free_rad + room_rad * np.tanh(excess_rad / room_rad)
    return np.where(excess_rad > 0, np.sign(angle_rad) * bent, angle_rad)


def body_rates(quat_xyzw: Float[np.ndarray, "t+1 4"], step_s: float) -> Float[np.ndarray, "t 3"]:
    """Angular velocity in body axes that carries each attitude exactly into the next."""
    before, after = quat_xyzw[:-1], quat_xyzw[1:]
    vector = (
        before[:, 3:] * after[:, :3]
        - after[:, 3:] * before[:, :3]
        - np.cross(before[:, :3], after[:, :3])
    )
    scalar = (before * after).sum(axis=1, keepdims=True)
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle_rad = 2 * np.arctan2(sine, scalar)
    return vector * np.where(sine > 1e-12, angle_rad / np.maximum(sine, 1e-12), 2.0) / step_s
