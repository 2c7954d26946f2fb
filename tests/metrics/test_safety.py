"""The safety suite against one frame after the other, and its edge cases."""

import math

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import SafetyScores
from src.ontology import CAR, FREE, THIN_STRUCTURE
from tests.metrics.inputs import LINE, coins, line, scores_of


def expected_scores(
    grid, batch, horizon_s=5.0, min_speed_mps=5.0, tube_radius_m=1.0, tube_s=2.0, thin_tolerance=1
):
    preds, target, velocity = batch
    centers_m = grid.centers(torch.float64)
    every, bubble, tube, frames = [], [], [], []  # of (truly occupied, predicted occupied)
    thin = []  # of (found, found nearby)
    for true, guess, v in zip(target, preds, velocity.double()):
        known, occupied = true != 255, torch.stack([true != FREE, guess != FREE])
        every.append(occupied[:, known])
        near = centers_m.norm(dim=-1) <= horizon_s * max(float(v.norm()), min_speed_mps)
        bubble.append(occupied[:, known & near])

        end_m = tube_s * v
        along = (centers_m @ end_m / end_m.square().sum()).nan_to_num(0.0).clamp(0, 1)
        swept = (centers_m - along[..., None] * end_m).norm(dim=-1) <= tube_radius_m
        tube.append(occupied[:, known & swept])
        if (known & swept).any():
            frames.append(tube[-1].any(dim=1, keepdim=True))

        wires, seen = (torch.nonzero(known & (of == THIN_STRUCTURE)) for of in (true, guess))
        off = (wires[:, None] - seen).abs().amax(dim=-1)
        thin.append(torch.stack([(off == 0).any(1), (off <= thin_tolerance).any(1)]))

    def share(which, among):
        return float(which[among].double().mean())

    (true, said), near, swept, found = (torch.cat(each, 1) for each in (every, bubble, tube, thin))
    blocked, called = torch.cat(frames, 1) if frames else torch.zeros(2, 0, dtype=torch.bool)
    return {
        "false_free_rate": share(~near[1], near[0]),
        "collision_miss_rate": share(~swept[1], swept[0]),
        "collision_miss_frames": share(~called, blocked),
        "phantom_stop_rate": share(called, ~blocked),
        "phantom_voxel_rate": share(swept[1], ~swept[0]),
        "thin_recall": float(found[0].double().mean()),
        "thin_recall_tolerant": float(found[1].double().mean()),
        "geometric_iou": share(true & said, true | said),
    }


def check(grid, batch, **arguments):
    expected = expected_scores(grid, batch, **arguments)
    actual = scores_of(SafetyScores(grid, **arguments), batch)
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert list(actual) == list(expected), "the documented order"
    return expected


@pytest.mark.parametrize("seed", [0, 4])
def test_every_score_matches_its_definition(grid, random_batch, seed):
    """With tubes that are truly free in some frames, and seen so."""
    preds, target, velocity = random_batch(seed, frames=12)
    empty = coins(9, target, 0.7) & (target != 255)
    preds = preds.masked_fill(coins(10, target, 0.85), FREE)
    batch = preds, target.masked_fill(empty, FREE), velocity
    expected = check(grid, batch, tube_radius_m=3.0, horizon_s=1.5)
    assert all(0 < score < 1 for score in expected.values())


OTHERS = [
    *({"tube_radius_m": radius_m} for radius_m in (0.5, 2.0, 5.0)),
    {"tube_radius_m": 6.0, "tube_s": 0.25},
    {"tube_radius_m": 40.0, "tube_s": 10.0},
    {"horizon_s": 0.5, "min_speed_mps": 20.0},
    *({"thin_tolerance": voxels} for voxels in (0, 2, 9)),
]
VELOCITIES = [(0, 0, 0), (-8, 3, 1), (1000, -350, 90), (0, 0, -1e6), (1e-30, 0, 0)]


@pytest.mark.parametrize("arguments", OTHERS)
def test_other_parameters_and_any_velocity_match_their_definition(grid, random_batch, arguments):
    preds, target, velocity = random_batch(3, frames=len(VELOCITIES))
    for each in (velocity, torch.tensor(VELOCITIES)):
        check(grid, (preds, target, each), **arguments)


def test_a_grid_that_the_path_never_enters_has_no_tube(random_batch):
    expected = check(VoxelGrid((0.0, 30.0, -6.0), (24.0, 50.0, 6.0), (6, 5, 3)), random_batch(0))
    without = {name for name, score in expected.items() if math.isnan(score)}
    assert {"collision_miss_rate", "phantom_voxel_rate"} <= without
    assert "geometric_iou" not in without


@pytest.mark.parametrize(("index", "rate"), [(2, 1.0), (3, math.nan)])
def test_the_bubble_holds_its_edge(index, rate):
    batch = (line(), line(**{f"x{index}": CAR}), torch.zeros(1, 3))
    scores = scores_of(SafetyScores(LINE, horizon_s=1.0), batch)
    assert scores["false_free_rate"] == pytest.approx(rate, nan_ok=True)


def test_another_class_may_be_the_thin_one(grid, random_batch):
    preds, target, velocity = random_batch(0)
    expected = float((preds[target == CAR] == CAR).double().mean())
    scores = scores_of(SafetyScores(grid, thin_index=CAR), (preds, target, velocity))
    assert scores["thin_recall"] == pytest.approx(expected)
