"""The same reference flown by another project's multirotor (rotorpy's Hummingbird)."""

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from src.loop.airframe import POSITION, ROTATION, STEP_S, Airframe
from tests.loop.test_airframe import circle, flown

# In a vacuum: its controller knows of no drag, ours does.
AIRLESS = quad_params | dict.fromkeys(("c_Dx", "c_Dy", "c_Dz", "k_d", "k_z", "k_h"), 0.0)


def theirs(reference):
    """Positions and thrust axes at every step."""
    vehicle, controller = Multirotor(AIRLESS), SE3Control(AIRLESS)
    hover = np.sqrt(quad_params["mass"] * 9.81 / 4 / quad_params["k_eta"])
    state = {"x": np.array([0.0, 0, 5]), "v": np.zeros(3), "q": np.array([0.0, 0, 0, 1])}
    state |= {"w": np.zeros(3), "wind": np.zeros(3), "rotor_speeds": np.full(4, hover)}

    places, axes = [], []
    for step, row in enumerate(reference):
        still = {name: np.zeros(3) for name in ("x_dddot", "x_ddddot")}
        flat = {"x": row[:3], "x_dot": row[3:6], "x_ddot": row[6:9], **still}
        flat |= {"yaw": row[9], "yaw_dot": 0.0, "yaw_ddot": 0.0}
        control = controller.update(step * STEP_S, state, flat)
        state = vehicle.step(state, control, STEP_S)
        x, y, z, w = state["q"]
        places.append(state["x"])
        axes.append([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return np.array(places), np.array(axes)


def test_both_fly_the_same_circle():
    reference = circle()
    places_m, axes = theirs(reference)
    states = flown(Airframe(wind_mps2=0.0, drag_per_s=0.0), reference)
    apart_m = np.linalg.norm(states[:, POSITION] - places_m, axis=1)
    assert np.sqrt((apart_m**2).mean()) < 0.05

    own = states[:, ROTATION].reshape(-1, 3, 3)[:, :, 2]
    angle_deg = np.degrees(np.arccos(np.clip((own * axes).sum(axis=1), -1, 1)))
    assert np.sqrt((angle_deg**2).mean()) < 2.0
