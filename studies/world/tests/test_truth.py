"""What is truly seen, in a scene of a few boxes; and that the audit finds labels that lie."""

import numpy as np
import pytest

from src.geometry import VoxelGrid
from src.ontology import BUILDING, CAR, CLASSES, FREE, GROUND, UNKNOWN, VEGETATION
from studies.world.agreement import SurfaceAgreement
from studies.world.truth import RAYS_A_SIDE, Camera, SurfaceTruth, rays_of
from tests.sim.scenery import (
    BODY_FROM_CAMERA,
    HEIGHT,
    PIX_FROM_CAMERA,
    WIDTH,
    Stage,
    actor,
    body_at,
    ground,
    solid,
)

GRID = VoxelGrid((0, -12, -8), (24, 12, 4), (48, 48, 24))
HERE = body_at((0.3, 0.2, 5.3), 0.1, 0.05, 0.3)
WALL = solid(BUILDING, (1.0, 16.0, 9.0), (18.4, 3, 4.5))
SCREEN = solid(VEGETATION, (1.0, 4.0, 9.0), (9.5, 2, 4.5))


def camera_at(world_from_body):
    return Camera(world_from_body, BODY_FROM_CAMERA, PIX_FROM_CAMERA, WIDTH, HEIGHT)


@pytest.fixture(scope="module")
def stage():
    stage = Stage(GRID, [ground(), WALL, SCREEN], [actor([(12.0, -2.0, 0.0)])])
    for _ in range(3):
        stage.sense(0, HERE, rays=16_000)
    stage.returns = stage.sense(0, body_at((4.0, -2.0, 5.3), yaw=0.2), rays=16_000)
    stage.freeze()
    return stage


@pytest.fixture(scope="module")
def truth(stage):
    return SurfaceTruth.of(stage.scene, 0, camera_at(HERE), GRID)


@pytest.fixture(scope="module")
def labels(stage):
    return stage.label(0, HERE, stage.returns)


def agreement_of(semantics, truth):
    agreement = SurfaceAgreement()
    agreement.add(semantics, truth)
    return agreement.table().set_index(["scope", "class"])


def test_rays_fill_every_pixel_evenly():
    directions = rays_of(camera_at(HERE))
    assert directions.shape == (WIDTH * HEIGHT * RAYS_A_SIDE**2, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


def test_seen_is_a_part_of_what_is_there_and_nothing_hidden(truth):
    assert (truth.seen & ~truth.touches).sum() == 0
    assert truth.seen[..., BUILDING].sum() > 50
    hidden = truth.holds[..., BUILDING] & ~truth.seen[..., BUILDING]
    assert hidden.sum() > 100, "the back of the wall, and what the screen hides"
    # Along a line of sight to a voxel's center nothing is met, so its own center is in the open.
    assert truth.center_seen.sum() > 5000
    assert (truth.center_seen & ~truth.inside).sum() == 0


def test_sound_labels_agree_with_the_truth(truth, labels):
    table = agreement_of(labels.semantics, truth)
    every = table.loc["visible", "all"]
    assert every["precision"] > 0.98
    assert every["recall"] > 0.85  # of two scans, where a clip has sixty
    assert every["free_error"] < 0.01
    assert table["ghosts"].max() == 0
    assert table.loc[("visible", "car"), "class_recall"] > 0.7


def test_a_ghost_is_found_and_counted_for_its_class(truth, labels):
    lying = labels.semantics.copy()
    air = truth.center_seen & ~truth.touches.any(axis=-1)
    spots = np.argwhere(air)[:7]
    lying[tuple(spots.T)] = CAR
    agreement = SurfaceAgreement()
    agreement.add(lying, truth)
    assert agreement.moving_ghosts == 7
    table = agreement.table().set_index(["scope", "class"])
    assert table.loc[("visible", "car"), "ghosts"] == 7
    assert table.loc[("visible", "building"), "ghosts"] == 0
    assert table.loc[("supervised", "all"), "ghosts"] == 7


def test_a_missed_surface_costs_recall_and_a_free_one_is_a_free_error(truth, labels):
    before = agreement_of(labels.semantics, truth).loc["visible"]
    seen = (truth.holds & truth.seen)[..., GROUND] & truth.inside & (labels.semantics == GROUND)
    spots = tuple(np.argwhere(seen)[:20].T)
    unknown, free = labels.semantics.copy(), labels.semantics.copy()
    unknown[spots], free[spots] = UNKNOWN, FREE
    after = agreement_of(unknown, truth).loc["visible"]
    assert after.loc["ground", "found"] == before.loc["ground", "found"] - 20
    assert after.loc["all", "free_wrong"] == before.loc["all", "free_wrong"]
    was, now = (
        agreement_of(semantics, truth).loc[("supervised", "all"), "free_wrong"]
        for semantics in (labels.semantics, free)
    )
    assert now == was + 20


def test_a_wrong_name_costs_the_class_but_not_the_occupancy(truth, labels):
    before = agreement_of(labels.semantics, truth).loc["visible"]
    renamed = labels.semantics.copy()
    renamed[renamed == BUILDING] = VEGETATION
    after = agreement_of(renamed, truth).loc["visible"]
    assert after.loc["building", "found"] == before.loc["building", "found"]
    assert after.loc["building", "named"] == 0
    assert after.loc["vegetation", "class_precision"] < 0.5
    assert after.loc["all", "precision"] == before.loc["all", "precision"]


def test_counts_of_frames_add_up(truth, labels):
    one, two = SurfaceAgreement(), SurfaceAgreement()
    one.add(labels.semantics, truth)
    two.add(labels.semantics, truth)
    two.join(one)
    assert two.frames == 2
    assert (two.counts == 2 * one.counts).all(axis=None)
    assert list(two.counts.loc["visible"].index) == [*CLASSES[:8], "all"]
