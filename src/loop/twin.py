"""The regret of a plan, against the same planner in the same state with the true grid."""

import math

import numpy as np

from ..geometry import VoxelGrid, world_from_occ
from .belief import BeliefMap
from .flight import Moment, Rules
from .perception import Truth
from .planner import Planner
from .true_occupancy import TrueOccupancy

# Beyond this, in metres of way, a plan is no worse: so an inadmissible one has a price.
MOST_M = 20.0
# The twin goes on for so long where the UAV stops.
PHANTOM_S = 1.0


class Twin:
    """Watches a flight, and plans anew at every moment with the truth of the grid.

    The regret of a plan is what it costs by the true map beyond what the twin's costs, in metres of
    way, at most 20. A plan is unsafe if by the true map it is not admissible, though one is. A
    *phantom stop* is a second or more in which every plan ends in a stop, or nothing admissible was
    found, and none of the twin's does.
    """

    def __init__(self, grid: VoxelGrid, planner: Planner, rules: Rules, truth: TrueOccupancy):
        self._planner, self._rules = planner, rules
        self._perception = Truth("twin", grid, in_sight=False)
        self._perception.begin(truth, "")
        self._map = BeliefMap(rules.map_cells, grid.voxel_m, rules.forget_s)
        self._regrets_m: list[float] = []
        self._unsafe, self._stops, self._standing = 0, 0, 0

    def __call__(self, moment: Moment) -> None:
        frame, plan, state = moment.frame, moment.plan, (moment.motion, self._map, moment.target_m)
        belief, matrix = self._perception(frame), world_from_occ(frame.world_from_body)
        self._map.update(belief, self._perception.grid, matrix, 1 / self._rules.plan_hz)
        best = self._planner(*state)

        price_m, least_m = self._planner.prices([plan, best], *state)
        self._regrets_m.append(min(price_m - least_m, MOST_M) if best.clear else 0.0)
        self._unsafe += best.clear and not math.isfinite(price_m)
        halts = plan.stops and not best.stops
        self._standing = self._standing + 1 if halts else 0
        self._stops += self._standing == math.ceil(PHANTOM_S * self._rules.plan_hz)

    def row(self) -> dict[str, object]:
        """Returns the mean regret, and how many plans were unsafe and how many stops phantoms."""
        regret_m = round(float(np.mean(self._regrets_m)), 4)
        counts = {"unsafe_plans": self._unsafe, "phantom_stops": self._stops}
        return {"plans": len(self._regrets_m), "regret_m": regret_m, **counts}
