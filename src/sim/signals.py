"""Traffic lights: one fixed-time plan a junction."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from .layout import Town

GREEN_S: Final = 10.0
AMBER_S: Final = 3.0
ALL_RED_S: Final = 2.0
PHASE_S: Final = GREEN_S + AMBER_S + ALL_RED_S


@dataclass(frozen=True)
class SignalPlan:
    """Phases that have green in turn, each followed by amber and by red for everyone."""

    phases: int
    offset_s: float
    """How far into the cycle time 0 is."""

    def is_green(self, phase: int, time_s: float) -> bool:
        return self._since_green_s(phase, time_s) < GREEN_S

    def red_for_s(self, phase: int, time_s: float) -> float:
        """How long the phase's light stays red from now; 0 where it is green or amber."""
        since_s = self._since_green_s(phase, time_s)
        return self.phases * PHASE_S - since_s if since_s >= GREEN_S + AMBER_S else 0.0

    def _since_green_s(self, phase: int, time_s: float) -> float:
        return (time_s + self.offset_s - phase * PHASE_S) % (self.phases * PHASE_S)


def signal_plans(town: Town, rng: np.random.Generator) -> dict[int, SignalPlan]:
    """The plan of every junction of a town that has lights, begun anywhere in its cycle."""
    phases = {
        path.gate.junction: path.gate.phases
        for path in (*town.lanes, *town.walks)
        if path.gate is not None and path.gate.phase is not None
    }
    return {
        junction: SignalPlan(phases[junction], rng.uniform(0, phases[junction] * PHASE_S))
        for junction in sorted(phases)
    }
