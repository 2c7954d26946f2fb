"""A small grid, and random batches for every metric."""

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import Calibration, KARBreakdown, OccupiedCalibration, PrimitiveMiss, RayIoU
from src.metrics.suite import ScoreSuite
from src.ontology import CAR, FREE
from tests.metrics.inputs import CLIPS, SUITE, coins, one_hot, random_logits, random_rays, truth_of

SHAPE = (6, 5, 3)


@pytest.fixture
def grid():
    return VoxelGrid(lower_m=(0.0, -10.0, -6.0), upper_m=(24.0, 10.0, 6.0), shape=SHAPE)


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
def four_classes(random_batch):
    """A `random_batch` whose labels are those of `FOUR_CLASSES`."""
    preds, target, velocity = random_batch(0, num_classes=4)
    return preds, torch.where(target == 255, -100, target.long()), velocity


@pytest.fixture
def sparse_batch(random_batch):
    """As `random_batch`, without velocity and mostly free, so that some rays meet nothing."""

    def make(seed, frames=4):
        preds, target, _ = random_batch(seed, frames)
        rng = torch.Generator().manual_seed(3)
        kept = torch.rand(target.shape, generator=rng) < 0.3
        preds = torch.where(torch.rand(target.shape, generator=rng) < 0.1, CAR, preds)
        known = target != 255
        return preds.masked_fill(~kept, FREE), target.masked_fill(~kept & known, FREE)

    return make


@pytest.fixture
def batch_for(random_batch, sparse_batch):
    """``batch_for(metric, seed, frames)`` -> what a metric of this class is updated with.

    With ``masked`` also the masks that it takes: the voxels to count, and the visible ones.
    """

    def make(metric, seed=0, frames=4, masked=False):
        batch = _, target, velocity = random_batch(seed, frames)
        if metric in (Calibration, PrimitiveMiss):
            batch = random_logits(seed, target), target, velocity
        if metric is OccupiedCalibration:
            batch = random_logits(seed, target).sigmoid()[:, 0], target, velocity
        if metric is RayIoU:
            batch = *sparse_batch(seed, frames), *random_rays(seed, frames)
        if masked:
            batch = *batch, coins(10 + seed, target)
        if masked and metric is KARBreakdown:
            batch = *batch, coins(20 + seed, target)
        return batch

    return make


@pytest.fixture
def scored(grid, random_batch):
    """A suite that has counted logits of two of its three clips."""
    suite = ScoreSuite(grid, CLIPS, SUITE)
    for seed, clip in enumerate(CLIPS[:2]):
        preds, target, velocity = random_batch(seed)
        suite.update(one_hot(preds), truth_of(target, velocity, [clip] * len(target)))
    return suite
