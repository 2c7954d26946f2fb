"""The airframe follows, tilts as its forces demand, and keeps its limits."""

import math

import numpy as np
import pytest

from src.errors import UserError
from src.loop.airframe import POSITION, RATES, ROTATION, STEP_HZ, STEP_S, VELOCITY, Airframe
from src.sim.attitude_dynamics import GRAVITY_MPS2

CALM = Airframe(wind_mps2=0.0)


def circle(seconds=8.0, radius_m=10.0, turn_radps=0.5):
    """A circle that begins at rest, with the yaw along it."""
    time_s = np.arange(1, round(seconds * STEP_HZ) + 1) * STEP_S
    angle = turn_radps * (time_s - 1 + np.exp(-time_s))
    rate, change = turn_radps * (1 - np.exp(-time_s)), turn_radps * np.exp(-time_s)
    cos, sin = np.cos(angle), np.sin(angle)
    outwards, along, zero = np.c_[sin, -cos], np.c_[cos, sin], np.zeros(len(angle))
    position = radius_m * np.c_[sin, 1 - cos]
    velocity = radius_m * rate[:, None] * along
    acceleration = radius_m * (change[:, None] * along - (rate**2)[:, None] * outwards)
    return np.c_[position, zero + 5, velocity, zero, acceleration, zero, angle]


def flown(airframe, reference, wind_mps2=None):
    start = airframe.at_rest(np.array([0.0, 0.0, 5.0]), 0.0)
    still = np.zeros((len(reference), 3))
    return airframe.follow(start, reference, still if wind_mps2 is None else wind_mps2)


def hovering(steps=400, x_m=0.0, yaw_rad=0.0):
    return np.tile(np.r_[x_m, 0, 5, np.zeros(6), yaw_rad], (steps, 1))


def test_it_follows_a_circle_with_rotations_and_hovers_level_where_nothing_is_asked():
    reference = circle()
    states = flown(CALM, reference)
    error_m = np.linalg.norm(states[:, POSITION] - reference[:, :3], axis=1)
    assert error_m.max() < 0.15
    assert np.sqrt((error_m**2).mean()) < 0.06
    rotation = states[:, ROTATION].reshape(-1, 3, 3)
    assert np.allclose(rotation @ rotation.swapaxes(1, 2), np.eye(3), atol=1e-9)

    states = flown(CALM, hovering())
    assert np.allclose(states[:, POSITION], [0, 0, 5], atol=1e-9)
    assert np.allclose(states[-1, ROTATION].reshape(3, 3), np.eye(3), atol=1e-9)


def test_the_thrust_axis_lies_along_acceleration_plus_gravity_plus_drag():
    """So the tilt is the one that the motion has, and no angle is drawn."""
    states = flown(CALM, circle())
    axes = states[:, ROTATION].reshape(-1, 3, 3)
    acceleration = np.diff(states[:, VELOCITY], axis=0) * STEP_HZ
    along = np.einsum("tij,ti->tj", axes[:-1], states[:-1, VELOCITY])
    along[:, 2] = 0
    drag = CALM.drag_per_s * np.einsum("tij,tj->ti", axes[:-1], along)
    force = acceleration + drag + [0, 0, GRAVITY_MPS2]
    cosine = np.einsum("ti,ti->t", force, axes[:-1, :, 2]) / np.linalg.norm(force, axis=1)
    assert math.degrees(math.acos(cosine.min())) < 1.5


def test_tilt_and_rates_stay_below_their_limits():
    jump = flown(CALM, hovering(x_m=50.0))
    tilt_deg = np.degrees(np.arccos(jump[:, ROTATION].reshape(-1, 3, 3)[:, 2, 2]))
    assert 34 < tilt_deg.max() < 37
    turn = flown(CALM, hovering(yaw_rad=1.5))
    most = np.maximum(*(np.abs(states[:, RATES]).max(axis=0) for states in (jump, turn)))
    assert (most <= [3.5, 3.5, 1.5]).all()
    assert most[1] == pytest.approx(3.5, abs=0.2)
    assert most[2] == pytest.approx(1.5, abs=0.1)


def test_wind_pushes_and_the_same_seed_blows_the_same():
    windy = Airframe()
    wind = [windy.wind(np.random.default_rng(seed), 4000) for seed in (0, 0, 1)]
    assert (wind[0] == wind[1]).all()
    assert not (wind[0] == wind[2]).all()
    assert (wind[0][:, 2] == 0).all()
    states = flown(windy, hovering(4000), wind[0])
    away_m = np.linalg.norm(states[:, POSITION] - [0, 0, 5], axis=1)
    assert 0.02 < away_m.max() < 0.5


@pytest.mark.parametrize("setting", [{"drag_per_s": -1.0}, {"rate_lag_s": 0.001}])
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(UserError, match=next(iter(setting))):
        Airframe(**setting)
