"""Roll and pitch of the UAV: what its motion demands, and what gusts add (App. A.1).

Body axes are x forward, y left, z up, so positive pitch is nose down and positive roll right side
down. Turning left therefore banks with negative roll.
"""

import numpy as np
from jaxtyping import Float

GRAVITY_MPS2 = 9.81

Vectors = Float[np.ndarray, "t 3"]
Angles = Float[np.ndarray, "t"]


def ornstein_uhlenbeck(
    rng: np.random.Generator, steps: int, step_s: float, kappa_per_s: float, sigma: float
) -> Float[np.ndarray, "steps"]:
    """Draws one path of the paper's ``d eta = kappa (mu - eta) dt + sigma dW`` with mean mu = 0.

    It begins in the steady state. The discretization is exact at any step: the standard deviation
    is sigma / sqrt(2 kappa).
    """
    keep = np.exp(-kappa_per_s * step_s)
    noise = rng.standard_normal(steps) * (sigma / np.sqrt(2 * kappa_per_s))
    # Each step forgets a part of the past and draws as much anew, so that the variance stays.
    noise[1:] *= np.sqrt(1 - keep**2)

    path = np.empty(steps)
    state = 0.0
    for k in range(steps):
        state = keep * state + noise[k]
        path[k] = state
    return path


def manoeuvre_attitude(
    velocity_mps: Vectors, acceleration_mps2: Vectors, yaw_rad: Angles, drag_per_s: float
) -> tuple[Angles, Angles]:
    """Returns the roll and pitch that point the thrust where the motion needs it.

    A multirotor pushes along its body z only, so that axis must lie along acceleration plus drag
    plus gravity: nose down to go forward, the inner side down in a turn.
    """
    thrust = acceleration_mps2 + drag_per_s * velocity_mps + np.array([0, 0, GRAVITY_MPS2])

    # Seen from a frame that shares the UAV's yaw, pitch comes first and roll after it.
    cos_yaw, sin_yaw = np.cos(yaw_rad), np.sin(yaw_rad)
    forward = cos_yaw * thrust[:, 0] + sin_yaw * thrust[:, 1]
    left = -sin_yaw * thrust[:, 0] + cos_yaw * thrust[:, 1]
    roll_rad = -np.arctan2(left, np.hypot(forward, thrust[:, 2]))
    return roll_rad, np.arctan2(forward, thrust[:, 2])


def soft_limit(angle_rad: Angles, limit_rad: float, knee: float = 2 / 3) -> Angles:
    """Keeps angles below a limit: unchanged up to a knee, then bent towards it smoothly."""
    free_rad = knee * limit_rad
    room_rad = limit_rad - free_rad
    excess_rad = np.maximum(np.abs(angle_rad) - free_rad, 0)
    bent_rad = free_rad + room_rad * np.tanh(excess_rad / room_rad)
    return np.where(excess_rad > 0, np.sign(angle_rad) * bent_rad, angle_rad)


def body_rates(quat_xyzw: Float[np.ndarray, "t+1 4"], step_s: float) -> Vectors:
    """Returns the angular velocity in body axes that carries each attitude into the next."""
    # The product of the earlier quaternion's conjugate and the later one is the turn between them.
    before, after = quat_xyzw[:-1], quat_xyzw[1:]
    vector = before[:, 3:] * after[:, :3] - after[:, 3:] * before[:, :3]
    vector = vector - np.cross(before[:, :3], after[:, :3])
    scalar = (before * after).sum(axis=1, keepdims=True)

    # A turn by zero has no axis: there the angle is twice the sine, and nothing is divided by 0.
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle_rad = 2 * np.arctan2(sine, scalar)
    return vector * np.where(sine > 1e-12, angle_rad / np.maximum(sine, 1e-12), 2.0) / step_s
