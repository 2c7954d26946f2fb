"""RayIoU against steps of a millimetre along every ray; the rays of a camera."""

import math

import numpy as np
import pytest
import torch

from src.geometry import camera_from_occ as chain
from src.geometry import (
    front_mount,
    inverse,
    pinhole,
    project,
    rigid,
    rotation_from_euler,
)
from src.metrics import RayIoU
from src.metrics import functional as F
from src.ontology import BUILDING, CAR, CLASSES, FREE
from tests.metrics.inputs import LINE, assert_same, line, mean, random_rays, scores_of, updated

STEP_M = 1e-3
AHEAD = torch.tensor([[[1.0, 0.0, 0.0]]])


def met_by_steps(labels, known, origin_m, direction, grid):
    """Class and distance of the first known voxel on a ray that is not free."""
    s = np.arange(0.0, 80.0, STEP_M)
    points = origin_m.numpy() + s[:, None] * direction.numpy()
    cells = np.floor((points - np.array(grid.lower_m)) / grid.voxel_m).astype(int)
    inside = ((cells >= 0) & (cells < np.array(grid.shape))).all(1)
    s, cells = s[inside], tuple(cells[inside].T)
    solid = (labels.numpy()[cells] != FREE) & known.numpy()[cells]
    if not solid.any():
        return None, math.inf
    first = solid.argmax()
    return int(labels.numpy()[cells][first]), float(s[first])


def met_in_batch(grid, preds, target, origin_m, directions):
    """(predicted, its distance), (true, its distance) of every ray."""
    return [
        [
            met_by_steps(labels[b], target[b] != 255, origin_m[b], directions[b, n], grid)
            for labels in (preds, target)
        ]
        for b in range(len(target))
        for n in range(directions.shape[1])
    ]


def expected_scores(rays, thresholds_m=(1.0, 2.0, 4.0)):
    solid = [ray for ray in rays if ray[1][0] is not None]
    clear = [ray for ray in rays if ray[1][0] is None]
    iou = {}
    for t in thresholds_m:
        for c in range(FREE):
            hits = sum(p == q == c and abs(d - e) < t for (p, d), (q, e) in solid)
            whole = sum((p == c) + (q == c) for (p, _), (q, _) in solid) - hits
            iou[t, c] = hits / whole if whole else math.nan

    by_threshold = [mean(iou[t, c] for c in range(FREE)) for t in thresholds_m]
    scores = {"ray_iou": mean(by_threshold)}
    scores |= {f"ray_iou_{t:g}m": score for t, score in zip(thresholds_m, by_threshold)}
    for c in range(FREE):
        scores[f"ray_iou/{CLASSES[c]}"] = mean(iou[t, c] for t in thresholds_m)
    scores["ray_phantom_rate"] = mean(ray[0][0] is not None for ray in clear)
    return scores


# ---------------------------------------------------------------------- against tiny steps


@pytest.mark.parametrize("seed", range(2))
def test_what_rays_meet_first_matches_tiny_steps(grid, sparse_batch, seed):
    preds, target = sparse_batch(seed)
    origin_m, directions = random_rays(seed)
    expected = iter(met_in_batch(grid, preds, target, origin_m, directions))
    codes = F.encode(preds, target, None, num_classes=9, ignore_index=255)
    for b in range(len(target)):
        actual = F.first_met(codes[b], origin_m[b], directions[b], grid, free_index=FREE)
        for classes, distances_m in zip(actual[0].T, actual[1].T):
            for class_id, distance_m, (other, other_m) in zip(classes, distances_m, next(expected)):
                assert class_id == (255 if other is None else other)
                assert distance_m == pytest.approx(other_m, abs=2 * STEP_M)


@pytest.mark.parametrize("thresholds_m", [(1.0, 2.0, 4.0), (0.5, 9.5)])
def test_every_score_matches_tiny_steps(grid, sparse_batch, thresholds_m):
    batches = [(*sparse_batch(seed), *random_rays(seed)) for seed in range(2)]
    rays = [ray for batch in batches for ray in met_in_batch(grid, *batch)]
    expected = expected_scores(rays, thresholds_m)
    actual = scores_of(RayIoU(grid, thresholds_m=thresholds_m), *batches)
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert 0 < expected["ray_iou"] < 1
    assert 0 < expected["ray_phantom_rate"] < 1


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rays_along_an_axis_match_tiny_steps(grid, sparse_batch, axis, sign):
    """From inside, from outside, and away from the grid."""
    preds, target = sparse_batch(1)
    direction = torch.zeros(len(target), 1, 3, dtype=torch.float64)
    direction[:, 0, axis] = sign
    for steps_m in (0.0, -30.0, 30.0):
        origin_m = torch.tensor([9.0, 0.5, -0.7]) + steps_m * direction[:, 0]
        expected = expected_scores(met_in_batch(grid, preds, target, origin_m, direction))
        actual = scores_of(RayIoU(grid), (preds, target, origin_m, direction))
        assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)


# ------------------------------------------------------------------------------------- by hand


def test_a_ray_that_starts_in_an_occupied_voxel_meets_it_at_once():
    codes = F.encode(line(x3=CAR), line(x3=BUILDING), None, num_classes=9, ignore_index=255)
    start_m = torch.tensor([6.5, 0.3, 0.0])
    classes, distances_m = F.first_met(codes[0], start_m, AHEAD[0], LINE, free_index=FREE)
    assert classes[:, 0].tolist() == [CAR, BUILDING]
    assert distances_m[:, 0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("index", "hits"), [(4, 3), (3, 1), (2, 0), (6, 0)])
def test_a_hit_is_nearer_than_the_threshold(index, hits):
    scores = scores_of(
        RayIoU(LINE), (line(**{f"x{index}": CAR}), line(x4=CAR), torch.zeros(1, 3), AHEAD)
    )
    assert [scores[f"ray_iou_{t}m"] for t in (1, 2, 4)] == [0.0] * (3 - hits) + [1.0] * hits
    assert scores["ray_iou"] == pytest.approx(hits / 3)


def test_a_batch_without_a_ray_changes_nothing(grid, batch_for):
    preds, target, origin_m, directions = batch = batch_for(RayIoU)
    expected = updated(RayIoU(grid), batch).counts
    no_frames = preds[:0], target[:0], origin_m[:0], directions[:0]
    no_rays = preds, target, origin_m, directions[:, :0]
    assert_same(updated(RayIoU(grid), batch, no_frames, no_rays).counts, expected)


# -------------------------------------------------------------------------- rays of a camera


WIDTH, HEIGHT = 80, 48


@pytest.fixture
def cameras():
    """``camera_from_occ`` of a level, a rolled and a pitched UAV, and ``pix_from_camera``."""
    euler = torch.tensor([[0.0, 0.0, 0.0], [0.3, -0.1, 1.2], [-0.2, 0.4, -2.0]]).double()
    world_from_body = rigid(rotation_from_euler(*euler.T), torch.tensor([[1.0, 2.0, 30.0]] * 3))
    mount = front_mount((0.1, 0.0, -0.05), pitch_rad=0.2)
    pix_from_camera = pinhole(WIDTH, HEIGHT, 1.2).expand(3, 3, 3)
    return chain(world_from_body.double(), mount.expand(3, 4, 4)), pix_from_camera


@pytest.mark.parametrize("rays", [(7, 5), (WIDTH, HEIGHT)])
def test_rays_start_at_the_camera_and_project_back_to_the_middles_of_their_parts(cameras, rays):
    origin_m, directions = F.camera_rays(*cameras, (WIDTH, HEIGHT), rays)
    torch.testing.assert_close(origin_m, inverse(cameras[0])[:, :3, 3])
    torch.testing.assert_close(directions.norm(dim=-1), torch.ones(3, rays[0] * rays[1]).double())
    pix, z_m = project(origin_m[:, None] + 20.0 * directions, *cameras)
    across, down = rays
    middles = [(n % across + 0.5, n // across + 0.5) for n in range(across * down)]
    part = torch.tensor([WIDTH / across, HEIGHT / down], dtype=torch.float64)
    torch.testing.assert_close(pix, (torch.tensor(middles) * part).expand_as(pix))
    assert (z_m > 0).all()
