"""Regret against a choice by hand."""

import math

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import PlanRegret
from src.metrics import functional as F
from src.ontology import BUILDING, CAR, FREE
from tests.metrics.inputs import LINE, line, scores_of, updated

AHEAD = {"turns_deg_per_s": [0.0], "climbs_deg": [0.0]}
WIDE = VoxelGrid(lower_m=(0, -12, -1), upper_m=(14, 12, 1), shape=(14, 24, 2))
TURNS = {"turns_deg_per_s": [-45.0, 0.0, 30.0, 45.0], "climbs_deg": [0.0], "radius_m": 0.8}
FAST = torch.tensor([[5.0, 0.0, 0.0]])


def wide(*boxes):
    """Free labels of `WIDE`, with cars in boxes of indices along x and y."""
    labels = torch.full((1, *WIDE.shape), FREE)
    for x, y in boxes:
        labels[0, x, y] = CAR
    return labels


STRAIGHT = slice(7, 9), slice(11, 13)
RIGHT = slice(2, 14), slice(0, 10)
EVERYWHERE = slice(3, 5), slice(0, 24)


def price(turn_deg_per_s, seconds=2.0):
    """How far from straight on a turn of that long ends, of the length flown."""
    turn = math.radians(turn_deg_per_s)
    end = complex(math.sin(turn * seconds), 1 - math.cos(turn * seconds)) / (turn * seconds)
    return abs(end - 1)


def regret(preds, target, **options):
    return scores_of(PlanRegret(WIDE, **TURNS | options), (preds, target, FAST))


def test_a_way_that_is_seen_as_it_is_costs_nothing():
    for boxes in ([], [STRAIGHT], [EVERYWHERE]):
        scores = regret(wide(*boxes), wide(*boxes))
        assert scores["plan_regret"] == scores["unsafe_plan_rate"] == 0


def test_a_turn_for_nothing_costs_what_it_is_long():
    scores = regret(wide(STRAIGHT), wide())
    assert scores["plan_regret"] == pytest.approx(price(30))
    assert scores["unsafe_plan_rate"] == scores["needless_stop_rate"] == 0


def test_a_stop_for_nothing_costs_one():
    scores = regret(wide(EVERYWHERE), wide())
    assert scores["plan_regret"] == scores["needless_stop_rate"] == 1


def test_a_plan_into_something_costs_as_configured_beyond_the_way_around_it():
    scores = regret(wide(), wide(STRAIGHT), collision=3.0)
    assert scores["unsafe_plan_rate"] == 1
    assert scores["plan_regret"] == pytest.approx(3 - price(30))


def test_what_is_blocked_besides_the_choice_costs_nothing():
    assert regret(wide(STRAIGHT), wide(STRAIGHT, RIGHT))["plan_regret"] == 0


def test_the_choice_is_the_cheapest_of_all_that_are_clear(grid, random_batch):
    preds, target, velocity = random_batch(0, frames=8)
    some = torch.rand(target.shape, generator=torch.Generator().manual_seed(0)) < 0.02
    target = torch.where(some | (target == 255), target, FREE)
    preds = torch.where(some.roll(1, 1), preds, FREE)
    metric = PlanRegret(grid, radius_m=4.0)
    chosen = metric.frame_tables(preds, target, velocity)["chosen"]

    turns, climbs = metric.turns_deg_per_s, metric.climbs_deg
    codes = F.encode(preds, target, None, 9, 255)
    for n in range(8):
        speed = max(float(velocity[n].norm()), 5.0)
        paths = F.primitive_paths(velocity[n], speed, turns, climbs, 2.0, grid.voxel_m / 2)
        swept = F.swept(codes[n], None, paths, 4.0, grid, FREE)
        straight = climbs.index(0) * len(turns) + turns.index(0)
        costs = [math.dist(path[-1], paths[straight][-1]) / (2 * speed) for path in paths]

        def cheapest(clear, costs=costs):
            return min((cost, k) for k, cost in enumerate(costs) if clear[k])[1]

        clear = swept.known & (swept.met == 255)
        expected = cheapest(swept.known & ~swept.said), cheapest(clear)
        hit = int(swept.met[expected[0]] != 255)
        assert chosen[n].nonzero().tolist() == [[*expected, hit]]


def test_a_frame_without_a_label_is_not_counted():
    unknown = torch.full((1, *LINE.shape), 255)
    metric = updated(PlanRegret(LINE, **AHEAD), (line(), unknown, FAST), (line(), line(), FAST))
    assert metric.chosen.sum() == 1


def test_a_stop_that_is_needed_is_no_needless_one():
    scores = scores_of(
        PlanRegret(LINE, **AHEAD),
        (line(x2=BUILDING), line(x2=BUILDING), FAST),
        (line(x2=BUILDING), line(), FAST),
        (line(), line(), FAST),
    )
    assert scores["needless_stop_rate"] == 0.5
    assert scores["plan_regret"] == pytest.approx(1 / 3)
