"""The roll and pitch that motion and gusts give the UAV."""

import numpy as np
import pytest
import torch

from src.geometry import rotation_from_euler
from src.sim import attitude_dynamics
from src.sim.attitude_dynamics import GRAVITY_MPS2, ornstein_uhlenbeck, soft_limit


@pytest.mark.parametrize("step_s", [0.02, 0.5])
def test_the_process_has_the_paper_s_moments_at_any_step(step_s):
    kappa, sigma = 1.5, 0.2
    eta = ornstein_uhlenbeck(np.random.default_rng(0), 200_000, step_s, kappa, sigma)
    assert eta.mean() == pytest.approx(0, abs=0.01)
    assert eta.std() == pytest.approx(sigma / np.sqrt(2 * kappa), rel=0.05)
    lag = np.corrcoef(eta[:-1], eta[1:])[0, 1]
    assert lag == pytest.approx(np.exp(-kappa * step_s), abs=0.01)


@pytest.mark.parametrize("yaw", [0.0, 1.1, -2.5])
def test_the_thrust_axis_carries_the_acceleration(yaw):
    """So the inner side goes down in a turn, and the nose to go forward."""
    rng = np.random.default_rng(0)
    velocity_mps, acceleration_mps2 = rng.normal(0, 4, (2, 100, 3))
    yaw_rad = np.full(100, yaw)
    roll_rad, pitch_rad = attitude_dynamics.manoeuvre_attitude(
        velocity_mps, acceleration_mps2, yaw_rad, 0.2
    )
    angles_rad = torch.from_numpy(np.array([roll_rad, pitch_rad, yaw_rad]))
    up_body = rotation_from_euler(*angles_rad)[:, :, 2].numpy()
    thrust = acceleration_mps2 + 0.2 * velocity_mps + (0, 0, GRAVITY_MPS2)
    assert up_body == pytest.approx(thrust / np.linalg.norm(thrust, axis=1, keepdims=True))


def test_the_limit_is_soft():
    angles_rad = np.linspace(-1.5, 1.5, 301)
    limited = soft_limit(angles_rad, 0.5)
    assert np.abs(limited).max() <= 0.5
    assert (np.diff(limited) >= 0).all()
    # Below the knee, at two thirds of the limit, nothing changes.
    small = np.abs(angles_rad) < 0.3
    assert limited[small] == pytest.approx(angles_rad[small])
