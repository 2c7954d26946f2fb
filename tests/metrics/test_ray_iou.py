"""RayIoU against steps of a millimetre along every ray; the rays of a camera."""

import math

import numpy as np
import pytest
import torch

from src import geometry
from src.metrics import RayIoU
from src.metrics import functional as F
from src.ontology import CAR, CLASSES, FREE
from tests.metrics.inputs import LINE, assert_same, line, mean, random_rays, scores_of, updated

STEP_M = 1e-3
AXES = torch.cat([torch.eye(3), -torch.eye(3)]).double()


def met_by_steps(labels, known, origin_m, direction, grid):
    """Class and distance of the first known voxel on a ray that is not free."""
    s = np.arange(0.0, 80.0, STEP_M)
    points = origin_m.numpy() + s[:, None] * direction.numpy()
    cells = np.floor((points - np.array(grid.lower_m)) / grid.voxel_m).astype(int)
    inside = ((cells >= 0) & (cells < np.array(grid.shape))).all(1)
    s, cells = s[inside], tuple(cells[inside].T)
    solid = (labels.numpy()[cells] != FREE) & known.numpy()[cells]
    if not solid.any():
        return 255, math.inf
    first = solid.argmax()
    return int(labels.numpy()[cells][first]), float(s[first])


def met_in_batch(grid, preds, target, origin_m, directions):
    """Classes and distances of what every ray meets, predicted and true: two arrays [rays, 2]."""
    met = [
        [
            met_by_steps(labels[b], target[b] != 255, origin_m[b], direction, grid)
            for labels in (preds, target)
        ]
        for b in range(len(target))
        for direction in directions[b]
    ]
    return np.moveaxis(np.array(met), -1, 0)


def expected_scores(classes, distances_m, thresholds_m):
    solid = classes[:, 1] != 255
    said, true = classes[solid].T
    apart_m = np.abs(np.subtract(*distances_m[solid].T))
    iou = {}
    for t in thresholds_m:
        for c in range(FREE):
            hits = ((said == c) & (true == c) & (apart_m < t)).sum()
            whole = (said == c).sum() + (true == c).sum() - hits
            iou[t, c] = hits / whole if whole else math.nan

    by_threshold = [mean(iou[t, c] for c in range(FREE)) for t in thresholds_m]
    scores = {"ray_iou": mean(by_threshold)}
    scores |= {f"ray_iou_{t:g}m": score for t, score in zip(thresholds_m, by_threshold)}
    for c in range(FREE):
        scores[f"ray_iou/{CLASSES[c]}"] = mean(iou[t, c] for t in thresholds_m)
    return scores | {"ray_phantom_rate": (classes[~solid, 0] != 255).mean()}


# ---------------------------------------------------------------------- against tiny steps


@pytest.mark.parametrize("seed", range(2))
def test_what_rays_meet_first_matches_tiny_steps(grid, sparse_batch, seed):
    """Rays in any direction and along the axes, from inside the grid and from outside."""
    preds, target = sparse_batch(seed)
    origin_m, directions = random_rays(seed)
    directions = torch.cat([directions, AXES.expand(len(target), 6, 3)], dim=1)
    classes, distances_m = met_in_batch(grid, preds, target, origin_m, directions)
    # A ray that starts in an occupied voxel meets it at once; the first seed has some.
    assert (distances_m == 0).any() == (seed == 0)

    codes = F.encode(preds, target, None, num_classes=9, ignore_index=255)
    met = [F.first_met(*each, grid, free_index=FREE) for each in zip(codes, origin_m, directions)]
    assert np.array_equal(np.concatenate([each.T for each, _ in met]), classes)
    actual_m = np.concatenate([each.T for _, each in met])
    np.testing.assert_allclose(actual_m, distances_m, rtol=0, atol=2 * STEP_M)


@pytest.mark.parametrize("thresholds_m", [(1.0, 2.0, 4.0), (0.5, 9.5)])
def test_every_score_matches_tiny_steps(grid, sparse_batch, thresholds_m):
    batches = [(*sparse_batch(seed), *random_rays(seed)) for seed in range(2)]
    met = np.concatenate([met_in_batch(grid, *batch) for batch in batches], axis=1)
    expected = expected_scores(*met, thresholds_m)
    actual = scores_of(RayIoU(grid, thresholds_m=thresholds_m), *batches)
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    assert 0 < expected["ray_iou"] < 1
    assert 0 < expected["ray_phantom_rate"] < 1


# ------------------------------------------------------------------------------------- by hand


@pytest.mark.parametrize(("index", "hits"), [(4, 3), (3, 1), (2, 0), (6, 0)])
def test_a_hit_is_nearer_than_the_threshold(index, hits):
    batch = line(**{f"x{index}": CAR}), line(x4=CAR), torch.zeros(1, 3), AXES[None, :1]
    scores = scores_of(RayIoU(LINE), batch)
    assert [scores[f"ray_iou_{t}m"] for t in (1, 2, 4)] == [0.0] * (3 - hits) + [1.0] * hits


def test_a_batch_without_a_ray_changes_nothing(grid, batch_for):
    preds, target, origin_m, directions = batch = batch_for(RayIoU)
    expected = updated(RayIoU(grid), batch).counts
    no_frames = preds[:0], target[:0], origin_m[:0], directions[:0]
    no_rays = preds, target, origin_m, directions[:, :0]
    assert_same(updated(RayIoU(grid), batch, no_frames, no_rays).counts, expected)


@pytest.mark.parametrize("rays", [(7, 5), (80, 48)])
def test_rays_start_at_the_camera_and_project_back_to_the_middles_of_their_parts(rays):
    """On a level, a rolled and a pitched UAV."""
    euler = torch.tensor([[0.0, 0.0, 0.0], [0.3, -0.1, 1.2], [-0.2, 0.4, -2.0]]).double()
    rotation = geometry.rotation_from_euler(*euler.T)
    world_from_body = geometry.rigid(rotation, torch.tensor([[1.0, 2.0, 30.0]] * 3).double())
    mount = geometry.front_mount((0.1, 0.0, -0.05), pitch_rad=0.2).expand(3, 4, 4)
    camera_from_occ = geometry.camera_from_occ(world_from_body, mount)
    cameras = camera_from_occ, geometry.pinhole(80, 48, 1.2).expand(3, 3, 3)

    origin_m, directions = F.camera_rays(*cameras, (80, 48), rays)
    torch.testing.assert_close(origin_m, geometry.inverse(camera_from_occ)[:, :3, 3])
    torch.testing.assert_close(directions.norm(dim=-1), torch.ones(3, rays[0] * rays[1]).double())
    pix, z_m = geometry.project(origin_m[:, None] + 20.0 * directions, *cameras)
    across, down = rays
    middles = [(n % across + 0.5, n // across + 0.5) for n in range(across * down)]
    part = torch.tensor([80 / across, 48 / down], dtype=torch.float64)
    torch.testing.assert_close(pix, (torch.tensor(middles) * part).expand_as(pix))
    assert (z_m > 0).all()
