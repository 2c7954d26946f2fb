"""Chains of paths as smooth curves."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from src.sim.route import Route, braked, chain
from tests.sim.roads import way

path = partial(way, half_width_m=3.0)
CROSS = (
    path((0, 0), (50, 0), successors=(1, 2, 3)),
    path((50, 0), (100, 0)),
    path((50, 0), (50, 60)),
    path((50, 0), (0, 0)),
)
STRAIGHT, TURN = (CROSS[0], CROSS[1]), (CROSS[0], CROSS[2])


def test_a_chain_takes_every_way_on_but_never_turns_back():
    chains = [chain(CROSS, np.random.default_rng(seed), 0, 90.0) for seed in range(40)]
    assert all(first is CROSS[0] for first, _ in chains)
    assert {tuple(last.points_m[-1]) for _, last in chains} == {(100, 0), (50, 60)}


def test_left_is_left_and_the_arc_is_the_true_length():
    straight = Route.through(STRAIGHT, 1.0)
    assert straight.shifted(np.full(len(straight.points_m), 2.0)).points_m[:, 1] == pytest.approx(2)
    turn = Route.through(TURN, 4.0)
    # On the outside of the turn the arc is longer, and is sampled anew.
    outside = turn.shifted(np.full(len(turn.points_m), -2.0))
    steps_m = np.linalg.norm(np.diff(outside.points_m, axis=0), axis=1)
    assert steps_m == pytest.approx(outside.spacing_m, rel=0.02)


def test_braking_reaches_every_limit_in_time():
    limits_mps = np.full(200, 10.0)
    limits_mps[120] = 2.0
    lowered = braked(limits_mps, 0.5, 2.5)
    assert (np.diff(lowered**2) >= -2 * 2.5 * 0.5 - 1e-9).all()
    # The slow place itself and all far from it keep their limits.
    assert lowered[[0, 120]].tolist() == [10.0, 2.0]
    assert (lowered <= limits_mps).all()


def test_the_rise_is_the_path_s_and_passes_over_smoothly():
    low, high = (replace(CROSS[k], rise_m=rise_m) for k, rise_m in ((0, 0.04), (1, 0.16)))
    route = Route.through((low, high), corner_m=1.0)
    for curve in (route, route.shifted(np.full(len(route.points_m), -1.5))):
        x_m, steps_m = curve.points_m[:, 0], np.diff(curve.rise_m)
        assert curve.rise_m[x_m < 46] == pytest.approx(0.04, abs=1e-4)
        assert curve.rise_m[x_m > 54] == pytest.approx(0.16, abs=1e-4)
        assert -1e-12 <= steps_m.min() < steps_m.max() < 0.015
