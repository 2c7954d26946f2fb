"""The scene of one mission: the town around its way, the traffic, and exact answers about both."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..sim.pilot import STEP_HZ
from ..sim.scene import Scene, static_parts
from ..sim.staging import DRAWN_RADIUS_M
from ..sim.traffic import TrafficConfig, simulate_traffic
from .mission import Mission
from .obstacles import Obstacles
from .true_occupancy import TrueOccupancy
from .vectors import Points, Vector

# So far from its way a UAV is expected, and its grid reaches beyond that, so far at least.
MARGIN_M = np.array([15.0, 15.0, 15.0])
GRID_REACH_M = 30.0
# With which a UAV that sees nothing sets out, in m/s2.
SETS_OUT_MPS2 = 2.0


@dataclass(frozen=True)
class Stage:
    """A mission with its scene, which lasts ``seconds``; its truth is known ``reach_m`` from where
    a UAV is expected."""

    mission: Mission
    scene: Scene
    seconds: float
    reach_m: float = GRID_REACH_M

    @classmethod
    def of(
        cls,
        mission: Mission,
        traffic: TrafficConfig,
        cruise_mps: float,
        seconds: float,
        draws: bool,
        reach_m: float = GRID_REACH_M,
    ) -> "Stage":
        """Builds the scene, as far as one looks where it ``draws``, else as far as one flies.

        Traffic starts where a UAV on the way would see it, and knows of no UAV.
        """
        blind_m = blind_track(mission, cruise_mps, seconds)
        place = mission.place
        actors = simulate_traffic(place.town, mission.rng("traffic"), traffic, blind_m)

        # The corners of the space that is known lie within it, so a picture changes no truth.
        radius_m = DRAWN_RADIUS_M if draws else math.hypot(*(MARGIN_M + reach_m)[:2])
        parts = static_parts(place.pieces, blind_m[::STEP_HZ, :2], radius_m)
        return cls(mission, Scene(parts, actors), seconds, reach_m)

    @cached_property
    def obstacles(self) -> Obstacles:
        return Obstacles(self.scene, *self._corners(MARGIN_M))

    @cached_property
    def truth(self) -> TrueOccupancy:
        return TrueOccupancy(self.scene, *self._corners(MARGIN_M + self.reach_m))

    def blind_hits(self, cruise_mps: float, radius_m: float) -> bool:
        """Tests the straight way of a body for collisions."""
        track_m = blind_track(self.mission, cruise_mps, self.seconds)
        return any(
            self.obstacles.nearest(*track_m[k : k + 2], (k, k + 1)).distance_m < radius_m
            for k in range(len(track_m) - 1)
            if (track_m[k] != track_m[k + 1]).any()
        )

    def _corners(self, margin_m: Vector) -> tuple[Vector, Vector]:
        ends_m = self.mission.at(np.array([0.0, self.mission.length_m]))
        return ends_m.min(axis=0) - margin_m, ends_m.max(axis=0) + margin_m


def blind_track(mission: Mission, cruise_mps: float, seconds: float) -> Points:
    """Returns the places of a UAV that flies straight along the way and waits at its end, at every
    step of the simulation."""
    times_s = np.arange(round(seconds * STEP_HZ) + 1) / STEP_HZ
    ramp_s = cruise_mps / SETS_OUT_MPS2
    setting_out_m = SETS_OUT_MPS2 / 2 * np.minimum(times_s, ramp_s) ** 2
    along_m = setting_out_m + cruise_mps * np.maximum(times_s - ramp_s, 0)
    return mission.at(np.minimum(along_m, mission.length_m))
