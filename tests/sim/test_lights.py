"""Traffic lights: the times of green, and the ways of a town that they are for."""

from itertools import product

import numpy as np
import pytest

from src.sim.lights import ALL_RED_S, AMBER_S, GREEN_S, PHASE_S, LightPlan
from src.sim.towns.network import Network, straight
from src.sim.towns.streetscape import TWO_LANES

STEP_S = 0.1
TIME_S = np.arange(0, 4 * PHASE_S, STEP_S) + STEP_S / 2
ENDS_M = np.array([(0, 0), (80, 0), (0, 80), (-80, 0), (0, -80)], dtype=float)


def cross():
    """Streets with lights from a junction in the middle to four around it, and between these."""
    pairs = (0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)
    return Network(ENDS_M, straight(ENDS_M, pairs, TWO_LANES), True)


def gates_at(paths, junction, is_crossing):
    """The gates by the direction (east 0, north 1, ...) in which the arm of each lies."""
    gates = {}
    for path in paths:
        gate = path.gate
        if gate and gate.junction == junction and gate.is_crossing == is_crossing:
            share = gate.at_m / path.length_m
            x_m, y_m = path.points_m[0] + share * (path.points_m[-1] - path.points_m[0])
            arm = round(np.arctan2(y_m, x_m) / (np.pi / 2)) % 4
            gates.setdefault(arm, []).append(gate)
    return gates


@pytest.mark.parametrize("phases", [2, 3])
@pytest.mark.parametrize("offset_s", [0.0, 4.2, 17.3])
def test_phases_have_green_and_amber_in_turn_and_then_all_have_red(phases, offset_s):
    lights = [("green", GREEN_S), ("amber", AMBER_S), ("red", ALL_RED_S)]
    cycle = [
        (phase, color)
        for phase in range(phases)
        for color, length_s in lights
        for _ in range(round(length_s / STEP_S))
    ]

    # The plan is compared with a list of the whole cycle, tick by tick.
    plan = LightPlan(phases, offset_s)
    for phase, time_s in product(range(phases), TIME_S):
        now = int((time_s + offset_s) / STEP_S) % len(cycle)
        waits = (cycle[now:] + cycle[:now]).index((phase, "green"))
        is_red = cycle[now][0] != phase or cycle[now][1] == "red"
        assert plan.is_green(phase, time_s) == (waits == 0)
        # While the light is amber one may not go, but a red that has begun ends with green.
        assert plan.red_for_s(phase, time_s) == pytest.approx(is_red * waits * STEP_S, abs=STEP_S)
        assert (plan.red_for_s(phase, time_s) > 0) == is_red


def test_opposing_arms_have_green_together_and_people_wait_for_their_own_arm():
    network = cross()
    lines = gates_at(network.lanes(), 0, is_crossing=False)
    crossings = gates_at(network.walks(), 0, is_crossing=True)
    assert set(lines) == set(crossings) == {0, 1, 2, 3}
    phase = {arm: gates[0].phase for arm, gates in lines.items()}
    assert phase[0] == phase[2] != phase[1] == phase[3]
    for arm, gates in crossings.items():
        assert [gate.phase for gate in gates] == [phase[arm]] * 2
        assert {gate.phases for gate in gates + lines[arm]} == {2}
