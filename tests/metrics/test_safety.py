"""The safety suite against plain loops over voxels, and its edge cases."""

import math
from itertools import product

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import SafetyScores
from src.ontology import CAR, FREE, THIN_STRUCTURE
from tests.metrics.inputs import LINE, coins, line, mean, scores_of, updated


def distance_to_path_m(point, end):
    length = math.hypot(*end)
    along = sum(p * e for p, e in zip(point, end))
    if along <= 0 or length == 0:
        return math.hypot(*point)
    if along >= length * length:
        return math.dist(point, end)
    (px, py, pz), (ex, ey, ez) = point, end
    return math.hypot(py * ez - pz * ey, pz * ex - px * ez, px * ey - py * ex) / length


def expected_scores(
    grid,
    preds,
    target,
    velocity,
    horizon_s=5.0,
    min_speed_mps=5.0,
    tube_radius_m=1.0,
    tube_s=2.0,
    thin_tolerance=1,
):
    every, bubble, tube, frames = [], [], [], []  # of (truly occupied, predicted occupied)
    thin = []  # of (found, found nearby)
    for b in range(len(target)):
        v = velocity[b].tolist()
        true, guess = target[b].tolist(), preds[b].tolist()
        places = [(x, y, z) for x, y, z in product(*map(range, grid.shape)) if true[x][y][z] != 255]
        wires = [(x, y, z) for x, y, z in places if guess[x][y][z] == THIN_STRUCTURE]

        in_tube = []
        for x, y, z in places:
            center = [low + (i + 0.5) * grid.voxel_m for low, i in zip(grid.lower_m, (x, y, z))]
            voxel = (true[x][y][z] != FREE, guess[x][y][z] != FREE)
            every.append(voxel)
            if math.hypot(*center) <= horizon_s * max(math.hypot(*v), min_speed_mps):
                bubble.append(voxel)
            if distance_to_path_m(center, [tube_s * part for part in v]) <= tube_radius_m:
                in_tube.append(voxel)
            if true[x][y][z] == THIN_STRUCTURE:
                off = [max(abs(x - i), abs(y - j), abs(z - k)) for i, j, k in wires]
                thin.append((0 in off, any(voxels <= thin_tolerance for voxels in off)))

        tube += in_tube
        if in_tube:
            frames.append((any(t for t, _ in in_tube), any(p for _, p in in_tube)))
    return {
        "false_free_rate": mean(not p for t, p in bubble if t),
        "collision_miss_rate": mean(not p for t, p in tube if t),
        "collision_miss_frames": mean(not p for t, p in frames if t),
        "phantom_stop_rate": mean(p for t, p in frames if not t),
        "phantom_voxel_rate": mean(p for t, p in tube if not t),
        "thin_recall": mean(found for found, _ in thin),
        "thin_recall_tolerant": mean(near for _, near in thin),
        "geometric_iou": mean(t and p for t, p in every if t or p),
    }


def check(grid, batch, **arguments):
    expected = expected_scores(grid, *batch, **arguments)
    actual = scores_of(SafetyScores(grid, **arguments), batch)
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert list(actual) == list(expected), "the documented order"
    return expected


@pytest.mark.parametrize("seed", [0, 4])
def test_every_score_matches_the_loops(grid, random_batch, seed):
    """With tubes that are truly free in some frames, and seen so."""
    preds, target, velocity = random_batch(seed, frames=12)
    empty = coins(9, target, 0.7) & (target != 255)
    preds = preds.masked_fill(coins(10, target, 0.85), FREE)
    batch = preds, target.masked_fill(empty, FREE), velocity
    expected = check(grid, batch, tube_radius_m=3.0, horizon_s=1.5)
    assert all(0 < score < 1 for score in expected.values())


OTHERS = [
    {"tube_radius_m": 0.5},
    {"tube_radius_m": 6.0, "tube_s": 0.25},
    {"tube_radius_m": 40.0, "tube_s": 10.0},
    {"horizon_s": 0.5, "min_speed_mps": 20.0},
    *({"thin_tolerance": voxels} for voxels in (0, 2, 9)),
]


@pytest.mark.parametrize("arguments", OTHERS)
def test_other_parameters_match_the_loops(grid, random_batch, arguments):
    check(grid, random_batch(3), **arguments)


@pytest.mark.parametrize(
    "velocity",
    [
        [0.0, 0.0, 0.0],
        [-8.0, 3.0, 1.0],
        [1000.0, -350.0, 90.0],
        [0.0, 0.0, -1e6],
        [1e-30, 0.0, 0.0],
    ],
)
def test_any_velocity_matches_the_loops(grid, random_batch, velocity):
    preds, target, like = random_batch(5)
    for radius_m in (2.0, 5.0):
        batch = preds, target, torch.tensor(velocity).expand_as(like)
        check(grid, batch, tube_radius_m=radius_m)


def test_a_grid_that_the_path_never_enters_has_no_tube(random_batch):
    aside = VoxelGrid((0.0, 30.0, -6.0), (24.0, 50.0, 6.0), (6, 5, 3))
    scores = scores_of(SafetyScores(aside), random_batch(0))
    assert math.isnan(scores["collision_miss_rate"])
    assert math.isnan(scores["phantom_voxel_rate"])
    assert not math.isnan(scores["geometric_iou"])


@pytest.mark.parametrize(("index", "rate"), [(2, 1.0), (3, math.nan)])
def test_the_bubble_holds_its_edge(index, rate):
    batch = (line(), line(**{f"x{index}": CAR}), torch.zeros(1, 3))
    scores = scores_of(SafetyScores(LINE, horizon_s=1.0), batch)
    assert scores["false_free_rate"] == pytest.approx(rate, nan_ok=True)


@pytest.mark.parametrize(("speed_mps", "in_tube"), [(0.0, 1), (2.0, 3), (3.0, 4), (-9.0, 1)])
def test_the_tube_reaches_as_far_as_the_next_seconds(speed_mps, in_tube):
    target, velocity = torch.full((1, *LINE.shape), CAR), torch.tensor([[speed_mps, 0.0, 0.0]])
    safety = updated(SafetyScores(LINE), (torch.full_like(target, FREE), target, velocity))
    assert safety.tube.tolist() == [[0, 0], [in_tube, 0]]


def test_another_class_may_be_the_thin_one(grid, random_batch):
    preds, target, velocity = random_batch(0)
    expected = float((preds[target == CAR] == CAR).double().mean())
    scores = scores_of(SafetyScores(grid, thin_index=CAR), (preds, target, velocity))
    assert scores["thin_recall"] == pytest.approx(expected)
