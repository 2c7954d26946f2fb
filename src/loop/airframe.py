"""A multirotor that follows a reference: the tilt that moves it comes from its forces."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..geometry import rigid
from ..jit import njit
from ..limits import require_at_least
from ..sim.attitude_dynamics import GRAVITY_MPS2, ornstein_uhlenbeck
from .vectors import Matrix, Points, Vector, dot

# Rate of the dynamics and of their controller.
STEP_HZ = 200
STEP_S = 1 / STEP_HZ

# Position, velocity, the columns of world_from_body's rotation, body rates, thrust.
State = Float[np.ndarray, "19"]
States = Float[np.ndarray, "t 19"]
POSITION, VELOCITY, ROTATION, RATES = slice(0, 3), slice(3, 6), slice(6, 15), slice(15, 18)

# One row a step: position, velocity and acceleration in the world, and yaw.
References = Float[np.ndarray, "t 10"]


@dataclass(frozen=True)
class Airframe:
    """A multirotor of unit mass with a geometric controller (Lee, Leok and McClamroch, 2010).

    Thrust acts along body z; thrust and body rates follow their commands with a lag of the first
    order. Rotor drag acts in the plane of the rotors, in proportion to the speed. Wind is an
    acceleration of the paper's Ornstein-Uhlenbeck process, so that the tilt follows from it. The
    controller knows the drag, not the wind. Raises `UserError` for a setting below 0.
    """

    position_gain_per_s2: float = 8.0
    velocity_gain_per_s: float = 5.0
    attitude_gain_per_s: float = 12.0
    thrust_lag_s: float = 0.05
    rate_lag_s: float = 0.04
    drag_per_s: float = 0.25
    tilt_limit_deg: float = 35.0
    rate_limit_radps: float = 3.5
    yaw_rate_limit_radps: float = 1.5
    thrust_limit_mps2: float = 20.0
    wind_mps2: float = 0.5  # standard deviation along each axis of the plane
    wind_kappa_per_s: float = 0.5

    def __post_init__(self) -> None:
        require_at_least(0, "airframe", vars(self), *vars(self))
        # A lag below the step would overshoot.
        require_at_least(STEP_S, "airframe", vars(self), "thrust_lag_s", "rate_lag_s")

    def at_rest(self, position_m: Vector, yaw_rad: float) -> State:
        """Returns the state of hovering level at a place."""
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.r_[position_m, np.zeros(3), rotation.ravel(), np.zeros(3), GRAVITY_MPS2]

    def wind(self, rng: np.random.Generator, steps: int) -> Points:
        """Draws the acceleration by the wind at every step; none along world z."""
        sigma = self.wind_mps2 * math.sqrt(2 * self.wind_kappa_per_s)
        kappa = max(self.wind_kappa_per_s, 1e-9)
        axes = [ornstein_uhlenbeck(rng, steps, STEP_S, kappa, sigma) for _ in range(2)]
        return np.stack([*axes, np.zeros(steps)], axis=1)

    def follow(self, state: State, reference: References, wind_mps2: Points) -> States:
        """Returns the states after each step of following a reference."""
        states = np.empty((len(reference), len(state)))

        gains = (self.position_gain_per_s2, self.velocity_gain_per_s, self.attitude_gain_per_s)
        lags = (self.thrust_lag_s, self.rate_lag_s)
        tilt, turns = math.radians(self.tilt_limit_deg), self.rate_limit_radps
        limits = math.tan(tilt), turns, self.yaw_rate_limit_radps, self.thrust_limit_mps2
        _follow(states, state, reference, wind_mps2, gains, lags, self.drag_per_s, limits)
        return states


def world_from_body(state: State) -> Matrix:
    """Returns the transform of a state."""
    return rigid(state[ROTATION].reshape(3, 3), state[POSITION])


# The compiled code keeps the three body axes, in the world, as the rows of ``body``; numba's own
# products of matrices would want SciPy.


@njit
def _follow(states, state, reference, wind, gains, lags, drag, limits):
    position, velocity = state[:3].copy(), state[3:6].copy()
    body, rates, thrust = state[6:15].copy().reshape(3, 3).T.copy(), state[15:18].copy(), state[18]

    for n in range(len(states)):
        push, command = _control(reference[n], position, velocity, body, gains, drag, limits)
        thrust += (push - thrust) * STEP_S / lags[0]
        rates += (command - rates) * STEP_S / lags[1]

        # Rotor drag acts along body x and y.
        force = thrust * body[2] + wind[n]
        force -= drag * (dot(velocity, body[0]) * body[0] + dot(velocity, body[1]) * body[1])
        force[2] -= GRAVITY_MPS2
        position += velocity * STEP_S + force * STEP_S**2 / 2
        velocity += force * STEP_S

        turn = (rates[0] * body[0] + rates[1] * body[1] + rates[2] * body[2]) * STEP_S
        _turn(body, turn)
        states[n, :3], states[n, 3:6], states[n, 15:18] = position, velocity, rates
        states[n, 6:15], states[n, 18] = body.T.copy().ravel(), thrust


@njit
def _control(wanted, position, velocity, body, gains, drag, limits):
    """Returns the wanted thrust and body rates."""
    push = wanted[6:9] + gains[0] * (wanted[:3] - position) + gains[1] * (wanted[3:6] - velocity)
    # The drag along the wanted motion is known; it acts almost level.
    push[:2] += drag * wanted[3:5]
    push[2] = max(push[2] + GRAVITY_MPS2, 0.3 * GRAVITY_MPS2)
    flat = np.hypot(push[0], push[1])
    if flat > limits[0] * push[2]:
        push[:2] *= limits[0] * push[2] / flat

    # Body z along the thrust, and body x as near to the heading as that allows.
    z = push / np.sqrt(dot(push, push))
    y = np.cross(z, np.array([np.cos(wanted[9]), np.sin(wanted[9]), 0.0]))
    y /= np.sqrt(dot(y, y))
    x = np.cross(y, z)
    axis = np.cross(body[0], x) + np.cross(body[1], y) + np.cross(body[2], z)

    command = np.empty(3)
    for a in range(3):
        most = limits[1] if a < 2 else limits[2]
        command[a] = min(max(gains[2] / 2 * dot(body[a], axis), -most), most)
    return min(dot(push, body[2]), limits[3]), command


@njit
def _turn(body, turn):
    """Turns each row about an axis, by the axis' length (Rodrigues)."""
    angle = np.sqrt(dot(turn, turn))
    if angle < 1e-12:
        return
    axis = turn / angle
    for a in range(3):
        along = dot(axis, body[a]) * (1 - np.cos(angle)) * axis
        body[a] = body[a] * np.cos(angle) + np.cross(axis, body[a]) * np.sin(angle) + along
