"""Traffic lights: every junction that has them follows one fixed-time plan."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from .layout import Town

GREEN_S: Final = 10.0
AMBER_S: Final = 3.0
ALL_RED_S: Final = 2.0
PHASE_S: Final = GREEN_S + AMBER_S + ALL_RED_S


@dataclass(frozen=True)
class LightPlan:
    """Phases that have green in turn, each followed by amber and by red for everyone.

    ``offset_s`` is how far into the cycle time 0 lies.
    """

    phases: int
    offset_s: float

    def is_green(self, phase: int, time_s: float) -> bool:
        """Returns whether the lights of a phase are green at a time."""
        return self._since_green_s(phase, time_s) < GREEN_S

    def red_for_s(self, phase: int, time_s: float) -> float:
        """Returns how long the phase's light stays red from now; 0 where it is green or amber."""
        since_s = self._since_green_s(phase, time_s)
        return self.phases * PHASE_S - since_s if since_s >= GREEN_S + AMBER_S else 0.0

    def _since_green_s(self, phase: int, time_s: float) -> float:
        return (time_s + self.offset_s - phase * PHASE_S) % (self.phases * PHASE_S)


def light_plans(town: Town, rng: np.random.Generator) -> dict[int, LightPlan]:
    """Draws the plan of every junction of a town that has lights: each starts anywhere in its
    cycle."""
    gates = [path.gate for path in (*town.lanes, *town.walks) if path.gate is not None]
    phases = {gate.junction: gate.phases for gate in gates if gate.phase is not None}

    # Junctions are sorted, so that the seed alone decides which draw belongs to which junction.
    return {
        junction: LightPlan(count, rng.uniform(0, count * PHASE_S))
        for junction, count in sorted(phases.items())
    }
