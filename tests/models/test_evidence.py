"""Class and depth of the pixels as evidence for voxels, where it can be told by hand."""

import math

import pytest
import torch

from src.geometry import VoxelGrid, front_mount
from src.models.evidence import REACH_VOXELS, Evidence
from src.ontology import CAR, NUM_CLASSES
from src.parallax import Parallax
from tests.models.synthetic import IMAGE_SIZE, build_batch, build_network, seen_by, sure_sight

# So fine that a voxel is several bins wide.
BINS = 192
GRID = VoxelGrid((0, -8, -4), (16, 8, 4), (16, 16, 8))
SHAPE = (1, BINS, IMAGE_SIZE[1] // 4, IMAGE_SIZE[0] // 4)


@pytest.fixture
def evidence():
    torch.manual_seed(0)
    return Evidence(GRID, 8, BINS, "attitude")


def voxels_of(evidence, tilt=(0.0, 0.0)):
    return seen_by(evidence.voxels, [tilt], front_mount((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.2)])
def test_a_surface_is_here_behind_or_hides_what_follows(evidence, tilt):
    references = voxels_of(evidence, tilt)
    found = evidence.of(sure_sight(8.0, SHAPE, CAR), references, 4)
    here, behind, classes, in_view = found.split([1, 1, NUM_CLASSES - 1, 1], dim=-1)
    assert in_view[..., 0].bool().equal(references.valid)
    assert not found[~references.valid].any()

    off_m = references.depth_m - 8.0
    bin_m, reach_m = 8.0 * math.log(64) / BINS, REACH_VOXELS * GRID.voxel_m
    near, far = off_m < -reach_m - bin_m, off_m > reach_m + bin_m
    at = off_m.abs() < reach_m - bin_m
    for where, is_here, is_behind in ((near, 0, 1), (at, 1, 0), (far, 0, 0)):
        seen = where & references.valid
        assert seen.sum() > 20
        assert (here[seen] - is_here).abs().max() < 1e-5
        assert (behind[seen] - is_behind).abs().max() < 1e-5
    assert classes[..., CAR].allclose(here[..., 0], atol=1e-5)
    assert classes.sum(dim=-1).allclose(here[..., 0], atol=1e-5)


def test_nothing_is_added_to_logits_before_it_is_learnt(evidence):
    found = evidence.of(sure_sight(8.0, SHAPE), voxels_of(evidence), 4)
    logits = evidence.logits(found, GRID.shape[:2])
    assert logits.shape == (1, NUM_CLASSES, *GRID.shape)
    assert not logits.any()
    assert evidence.pillars(found).shape == (1, 256, 8)


def test_the_voxels_loss_teaches_the_depth():
    network = build_network(parallax=Parallax(bins=12))
    step = network.step(build_batch(), None)
    step.logits.square().mean().backward()
    assert network.sight.layers[-1].weight.grad[NUM_CLASSES:].abs().sum() > 0
    assert all(p.grad is not None for p in network.evidence.parameters())
