"""Traffic lights: who has green when, and which ways of a town they are for."""

from itertools import pairwise

import numpy as np
import pytest

from src.sim.layout import Town
from src.sim.lights import ALL_RED_S, AMBER_S, GREEN_S, PHASE_S, LightPlan, light_plans
from src.sim.towns.network import Network, Street
from src.sim.towns.streetscape import TWO_LANES

STEP_S = 0.1
TIME_S = np.arange(0, 4 * PHASE_S, STEP_S) + STEP_S / 2
ENDS_M = np.array([(0, 0), (80, 0), (0, 80), (-80, 0), (0, -80)], dtype=float)


def cross(signals):
    """Streets from a junction in the middle to four around it, and between these."""
    pairs = (0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)
    streets = tuple(Street(a, b, ENDS_M[[a, b]], TWO_LANES) for a, b in pairs)
    return Network(ENDS_M, streets, signals)


def town(signals):
    network = cross(signals)
    return Town("t", lambda x, y: 0 * x, (), (), network.lanes(), network.walks(), ())


def gates_at(paths, junction, is_crossing):
    """By the direction (east 0, north 1, ...) in which the arm of each gate lies."""
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
@pytest.mark.parametrize("offset_s", [0.0, 17.3])
def test_phases_have_green_in_turn_and_never_together(phases, offset_s):
    plan = LightPlan(phases, offset_s)
    green = np.array([[plan.is_green(k, t) for k in range(phases)] for t in TIME_S])
    assert green.sum(axis=1).max() == 1
    cycle = round(phases * PHASE_S / STEP_S)
    assert green[:cycle].sum(axis=0) * STEP_S == pytest.approx(GREEN_S, abs=2 * STEP_S)
    order = [int(np.argmax(row)) for row in green if row.any()]
    turns = [a for a, b in pairwise(order) if a != b]
    assert all((b - a) % phases == 1 for a, b in pairwise(turns))
    assert plan.is_green(0, phases * PHASE_S - offset_s + 0.01)


def test_between_two_greens_there_is_amber_and_then_red_for_everyone():
    plan = LightPlan(2, 0.0)
    red = np.array([[plan.red_for_s(k, t) > 0 for k in range(2)] for t in TIME_S])
    green = np.array([[plan.is_green(k, t) for k in range(2)] for t in TIME_S])
    assert not (red & green).any()
    assert red.any(axis=1).all()
    all_red = red.all(axis=1)[: round(PHASE_S / STEP_S)]
    assert all_red.sum() * STEP_S == pytest.approx(ALL_RED_S)
    assert all_red[-round(ALL_RED_S / STEP_S) :].all()
    amber = ~red & ~green
    assert amber[: round(PHASE_S / STEP_S), 0].sum() * STEP_S == pytest.approx(AMBER_S)


def test_the_time_that_a_light_stays_red_is_the_time_until_green():
    plan = LightPlan(2, 4.2)
    for phase in range(2):
        green = np.array([plan.is_green(phase, t) for t in TIME_S])
        for k in np.flatnonzero([plan.red_for_s(phase, t) > 0 for t in TIME_S]):
            if green[k:].any():
                wait_s = int(np.argmax(green[k:])) * STEP_S
                assert plan.red_for_s(phase, TIME_S[k]) == pytest.approx(wait_s, abs=STEP_S)


def test_only_junctions_with_lights_have_plans_and_the_seed_decides():
    assert light_plans(town(signals=False), np.random.default_rng(0)) == {}
    plans = light_plans(town(signals=True), np.random.default_rng(0))
    assert set(plans) == {0, 1, 2, 3, 4}
    assert plans == light_plans(town(signals=True), np.random.default_rng(0))
    assert plans != light_plans(town(signals=True), np.random.default_rng(1))
    assert len({plan.offset_s for plan in plans.values()}) == 5
    for plan in plans.values():
        assert 0 <= plan.offset_s <= plan.phases * PHASE_S


def test_opposing_arms_have_green_together_and_people_wait_for_their_own_arm():
    network = cross(signals=True)
    lines = gates_at(network.lanes(), 0, is_crossing=False)
    crossings = gates_at(network.walks(), 0, is_crossing=True)
    assert set(lines) == set(crossings) == {0, 1, 2, 3}
    phase = {arm: gates[0].phase for arm, gates in lines.items()}
    assert phase[0] == phase[2] != phase[1] == phase[3]
    for arm, gates in crossings.items():
        assert [gate.phase for gate in gates] == [phase[arm]] * 2
    for gates in (*lines.values(), *crossings.values()):
        assert {gate.phases for gate in gates} == {2}


def test_where_a_road_only_goes_on_there_is_a_phase_for_people_as_well():
    streets = tuple(Street(0, k, ENDS_M[[0, end]], TWO_LANES) for k, end in ((1, 1), (2, 3)))
    network = Network(ENDS_M[[0, 1, 3]], streets, signals=True)
    gates = gates_at(network.lanes(), 0, is_crossing=False)
    assert {(gate.phase, gate.phases) for both in gates.values() for gate in both} == {(0, 2)}


def test_without_lights_there_are_lines_all_the_same():
    network = cross(signals=False)
    lanes = network.lanes()
    for path in lanes:
        leads_on = bool(path.successors) and any(not lanes[k].gate for k in path.successors)
        assert (path.gate is not None) == leads_on
    assert {path.gate.phase for path in (*lanes, *network.walks()) if path.gate} == {None}
