"""Regret against a choice by hand."""

import math

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import PlanRegret
from src.metrics import functional as F
from src.ontology import BUILDING, CAR, FREE
from tests.metrics.inputs import LINE, line, scores_of

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


@pytest.mark.parametrize(
    ("said", "true", "plan_regret", "unsafe", "needless"),
    [
        ([], [], 0, 0, 0),
        ([EVERYWHERE], [EVERYWHERE], 0, 0, math.nan),
        ([STRAIGHT], [], price(30), 0, 0),
        ([EVERYWHERE], [], 1, 0, 1),
        ([], [STRAIGHT], 3 - price(30), 1, 0),
        ([STRAIGHT], [STRAIGHT, RIGHT], 0, 0, 0),
    ],
)
def test_a_choice_costs_how_far_it_leads_off_and_a_collision_as_configured(
    said, true, plan_regret, unsafe, needless
):
    metric = PlanRegret(WIDE, **TURNS, collision=3.0)
    expected = {
        "plan_regret": plan_regret,
        "unsafe_plan_rate": unsafe,
        "needless_stop_rate": needless,
    }
    actual = scores_of(metric, (wide(*said), wide(*true), FAST))
    assert actual == pytest.approx(expected, nan_ok=True)


def test_the_choice_is_the_cheapest_of_all_that_are_clear(grid, random_batch):
    preds, target, velocity = random_batch(0, frames=8)
    some = torch.rand(target.shape, generator=torch.Generator().manual_seed(0)) < 0.02
    target = torch.where(some | (target == 255), target, FREE)
    target[:, :, 2:] = 255
    preds = torch.where(some.roll(1, 1), preds, FREE)
    metric = PlanRegret(grid, radius_m=4.0)
    chosen = metric.frame_counts(preds, target, velocity)["chosen"]

    turns, climbs = metric.turns_deg_per_s, metric.climbs_deg
    codes = F.encode(preds, target, None, 9, 255)
    for n in range(8):
        speed = max(float(velocity[n].norm()), 5.0)
        paths = F.primitive_paths(velocity[n], speed, turns, climbs, 2.0, grid.voxel_m / 2)
        swept = F.swept(codes[n], None, paths, 4.0, grid, FREE)
        straight = climbs.index(0) * len(turns) + turns.index(0)
        costs = [math.dist(path[-1], paths[straight][-1]) / (2 * speed) for path in paths]

        def cheapest(clear, costs=costs):
            stop = 1, len(costs)
            return min([stop, *((cost, k) for k, cost in enumerate(costs) if clear[k])])[1]

        clear = swept.known & (swept.met == 255)
        expected = cheapest(swept.known & ~swept.said), cheapest(clear)
        hit = int(expected[0] < len(costs) and swept.met[expected[0]] != 255)
        assert chosen[n].nonzero().tolist() == ([[*expected, hit]] if swept.known.any() else [])


def test_rates_are_means_over_frames_and_a_frame_without_a_label_is_none():
    unknown = torch.full((1, *LINE.shape), 255)
    scores = scores_of(
        PlanRegret(LINE, turns_deg_per_s=[0.0], climbs_deg=[0.0]),
        (line(x2=BUILDING), line(x2=BUILDING), FAST),
        (line(x2=BUILDING), line(), FAST),
        (line(), line(), FAST),
        (line(), unknown, FAST),
    )
    assert scores["needless_stop_rate"] == 0.5
    assert scores["plan_regret"] == pytest.approx(1 / 3)
