"""A flight in a closed loop as a clip: filmed and labelled by the chain of all our clips."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from ..data.clip import CLIP_SECONDS
from ..data.rates import STEP_HZ as SCENE_HZ
from ..errors import UserError
from ..geometry import euler_from_rotation, quat_from_euler
from ..sim.clip_maker import ClipMaker
from ..sim.flight import Flight
from ..sim.scene import Scene
from ..sim.staging import ClipPlan
from .airframe import POSITION, RATES, ROTATION, VELOCITY, States
from .campaign import Campaign, Job
from .flight import STEPS_A_SCENE_STEP


class FlightFilmer(ClipMaker):
    """Makes clips of the flights of a UAV that knows the truth, by the ids of the clips.

    ``config`` is the composed configuration. Raises `UserError` as `ClipMaker` and `Campaign` do.
    """

    def __init__(self, config: Mapping, root: Path, jobs: Mapping[str, Job]) -> None:
        super().__init__(config["sim"], root)
        self._campaign, self._jobs = Campaign(config), jobs

    def film(self, clip_id: str) -> None:
        """Writes the clip of a flight."""
        mission = self._jobs[clip_id].mission
        self.make(ClipPlan(clip_id, mission.town, mission.weather, mission.index), lambda: None)

    def stage(self, plan: ClipPlan) -> tuple[Flight, Scene]:
        """Returns a flight and its scene. Raises `UserError` for one shorter than a clip."""
        stage, states = self._campaign.flown_by_truth(self._jobs[plan.clip_id])
        steps = states[::STEPS_A_SCENE_STEP][: round(CLIP_SECONDS * SCENE_HZ)]
        if len(steps) < CLIP_SECONDS * SCENE_HZ:
            raise UserError(
                f"mission.length_m: {plan.clip_id} ends after {len(steps) / SCENE_HZ:.1f} s, and a "
                f"clip has {CLIP_SECONDS:g}; give a longer way or a lower planner.cruise_mps"
            )
        terrain = stage.mission.place.town.terrain
        return flight_of(steps, terrain(*steps[:, POSITION].T[:2])), stage.scene


def flight_of(states: States, ground_m: np.ndarray) -> Flight:
    """Returns the states of an airframe, one a step of the scene, over ground of these heights."""
    rotation = torch.from_numpy(states[:, ROTATION].reshape(-1, 3, 3).copy())
    angles = euler_from_rotation(rotation)
    roll_rad, pitch_rad, yaw_rad = (each.numpy() for each in angles)

    return Flight(
        time_s=np.arange(len(states)) / SCENE_HZ,
        position_m=states[:, POSITION].copy(),
        quat_xyzw=quat_from_euler(*angles).numpy(),
        velocity_mps=states[:, VELOCITY].copy(),
        body_rates_radps=states[:, RATES].copy(),
        roll_rad=roll_rad,
        pitch_rad=pitch_rad,
        yaw_rad=yaw_rad,
        altitude_m=states[:, POSITION][:, 2] - ground_m,
    )
