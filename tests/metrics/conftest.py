"""A small grid, random batches, and KAR-IoU written out as plain loops from App. A.4."""

import math

import pytest
import torch

from src.geometry import VoxelGrid

LOWER_M, SIDE_M, SHAPE = (0.0, -10.0, -6.0), 4.0, (6, 5, 3)


@pytest.fixture
def grid():
    upper_m = tuple(lower + SIDE_M * n for lower, n in zip(LOWER_M, SHAPE))
    return VoxelGrid(LOWER_M, upper_m, SHAPE)


@pytest.fixture
def random_batch():
    """``random_batch(seed, frames)`` -> preds, target, velocity: mostly free, half right."""

    def make(seed, frames=4, num_classes=9):
        rng = torch.Generator().manual_seed(seed)
        size = (frames, *SHAPE)
        target = torch.randint(0, num_classes + 6, size, generator=rng).clamp(max=num_classes - 1)
        unknown = torch.rand(size, generator=rng) < 0.2
        other = torch.randint(0, num_classes, size, generator=rng)
        preds = torch.where(torch.rand(size, generator=rng) < 0.5, target, other)
        target = target.masked_fill(unknown, 255)
        velocity = 6 * torch.randn(frames, 3, generator=rng)
        return preds.to(torch.uint8), target.to(torch.uint8), velocity

    return make


@pytest.fixture
def kar_iou_by_loops():
    """KAR-IoU of every class, NaN where the class has no TP, FP or FN."""

    def penalty(voxel, velocity, horizon_s, decay_per_s, penalty_scale, min_speed_mps):
        centre_m = [lower + (i + 0.5) * SIDE_M for lower, i in zip(LOWER_M, voxel)]
        speed_mps = max(math.sqrt(sum(v * v for v in velocity)), min_speed_mps)
        ttc_s = math.sqrt(sum(x * x for x in centre_m)) / speed_mps
        inside = 1 if ttc_s <= horizon_s else 0
        return 1 + inside * penalty_scale * math.exp(-decay_per_s * ttc_s)

    def kar_iou(preds, target, velocity, num_classes=9, mask=None, **parameters):
        defaults = {"horizon_s": 5, "decay_per_s": 0.5, "penalty_scale": 2, "min_speed_mps": 5}
        parameters = defaults | parameters
        hits, errors = [0] * num_classes, [0.0] * num_classes
        for b in range(len(target)):
            for x in range(SHAPE[0]):
                for y in range(SHAPE[1]):
                    for z in range(SHAPE[2]):
                        t, p = int(target[b, x, y, z]), int(preds[b, x, y, z])
                        if t == 255 or (mask is not None and not mask[b, x, y, z]):
                            continue
                        if t == p:
                            hits[t] += 1
                            continue
                        weight = penalty((x, y, z), velocity[b].tolist(), **parameters)
                        errors[t] += weight
                        errors[p] += weight
        return [h / (h + e) if h + e else math.nan for h, e in zip(hits, errors)]

    return kar_iou
