"""The annotation chain (App. A.3), stage by stage, in scenes of a few boxes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from src.geometry import VoxelGrid, inverse, transform, world_from_occ
from src.ontology import BUILDING, CAR, FREE, GROUND, UNKNOWN, VEGETATION, VRU
from src.sim.annotation import MIN_LIDAR_RETURNS, MIN_VISIBLE_PIXELS, elect, sees_through, space_of
from src.sim.fusion import ActorMap
from src.sim.scene import ScanHits, Scene, parts_of
from src.sim.sensors import Scan
from tests.sim import scenery
from tests.sim.scenery import Stage, actor, body_at, ground, places_of, solid, view_of

GRID = VoxelGrid((0, -12, -8), (24, 12, 4), (24, 24, 12))
FINE = VoxelGrid((4, -12, -8), (24, 12, 4), (40, 48, 24))
HERE = body_at((0.3, 0.2, 5.3))
WALL = solid(BUILDING, (1.0, 16.0, 9.0), (20.4, 0, 4.5))
SCREEN = solid(VEGETATION, (1.0, 14.0, 9.0), (8.5, 0, 4.5))


def centers_world(world_from_body, grid=GRID):
    points = grid.centers(torch.float64).reshape(-1, 3)
    return transform(world_from_occ(world_from_body), points).numpy().reshape(*grid.shape, 3)


def inside(points_m, low_m, high_m):
    return ((points_m > low_m) & (points_m < high_m)).all(axis=-1)


def scanned(grid, static, actors, *places):
    """A stage frozen after a scan from every place at its step, and the last scan's returns."""
    stage = Stage(grid, static, actors)
    returns = [stage.sense(step, place) for step, place in places]
    stage.freeze()
    return stage, returns[-1]


def cells_of(static, points_m):
    """Index of the map's cell around each place, and whether the map has that cell."""
    cell = np.floor((points_m - static.cells.lower_m) / static.cells.side_m).astype(int)
    return cell, ((cell >= 0) & (cell < static.free.shape)).all(axis=-1)


def pixel_voxels(view, here):
    """The voxel of every pixel that shows something in the grid."""
    ends_m = torch.from_numpy(places_of(view, here)[np.isfinite(view.depth_m)])
    index, within = GRID.index_of(transform(inverse(world_from_occ(here)), ends_m))
    return tuple(index[within].T.numpy())


# ----------------------------------------------------------------------------- static and free


def test_what_is_hidden_now_is_known_from_elsewhere():
    behind = inside(centers_world(HERE), (19.7, -7, 1), (20.2, 7, 8))
    alone, _ = scanned(GRID, [ground(), WALL, SCREEN], [], (0, HERE))
    assert (alone.label(0, HERE, {}).semantics[behind] == UNKNOWN).all()

    beside = body_at((12.0, 0.0, 5.3))
    fused, _ = scanned(GRID, [ground(), WALL, SCREEN], [], (0, HERE), (0, beside))
    labels = fused.label(0, HERE, {})
    supervised = labels.semantics[behind] != UNKNOWN
    assert supervised.sum() > 20
    assert (labels.semantics[behind][supervised] == BUILDING).mean() > 0.9
    assert not labels.visible[behind].any()


def test_space_between_is_free_and_what_nothing_saw_is_unknown():
    stage, _ = scanned(GRID, [ground(), WALL], [], (0, HERE))
    semantics, centers_m = stage.label(0, HERE, {}).semantics, centers_world(HERE)
    assert (semantics[inside(centers_m, (8, -3, 3.5), (18.5, 3, 7))] == FREE).all()
    # Behind the wall, and below the ground.
    assert (semantics[inside(centers_m, (21.6, -5, 1), (24, 5, 6))] == UNKNOWN).all()
    assert (semantics[inside(centers_m, (0, -12, -8), (24, 12, -1.1))] == UNKNOWN).all()

    wall = semantics[inside(centers_m, (19.5, -6, 1.5), (20.4, 6, 7))]
    assert np.isin(wall, [BUILDING, UNKNOWN]).all()
    assert (wall == BUILDING).sum() > 10


@pytest.mark.parametrize("yaw", [0.0, 0.3, np.pi / 4, 1.2])
def test_no_rotation_of_the_frame_opens_holes_in_a_fused_surface(yaw):
    """Fails if voxels of a fused grid were carried over by their centers instead of points."""
    middle_m = (14.0 * np.cos(yaw), 14.0 * np.sin(yaw), 0.0)
    stage = Stage(FINE, [solid(BUILDING, (0.8, 60.0, 30.0), middle_m, yaw_rad=yaw)])
    for k in range(6):
        stage.sense(0, body_at((0.2 * k, 0.0, 5.3), yaw=yaw), rays=16_000)
    stage.freeze()

    here = body_at((0.3, 0.1, 5.3), yaw=yaw + 0.35)
    votes = np.zeros((*FINE.shape, FREE), np.int32)
    stage.static.vote(votes, FINE, inverse(world_from_occ(here)).numpy())
    # Along every line of voxels straight ahead that meets the wall, some voxel must hold it.
    ahead = (votes[..., BUILDING] > 0).any(axis=0)[8:-8, 4:-4]
    assert ahead.mean() > 0.99


def test_free_is_a_voxel_whose_center_lies_in_a_cell_that_a_ray_passed():
    stage, _ = scanned(GRID, [ground(), WALL], [], (0, HERE))
    static = stage.static
    for yaw in (0.0, 0.7, -2.5):
        here = body_at((0.3, 0.2, 5.3), yaw=yaw)
        cell, in_map = cells_of(static, centers_world(here))
        expected = np.zeros(GRID.shape, dtype=bool)
        expected[in_map] = static.free[tuple(cell[in_map].T)] == 1

        free = static.free_in(GRID, world_from_occ(here).numpy())
        np.testing.assert_array_equal(free, expected)
        assert 100 < free.sum() < free.size


# -------------------------------------------------------------------------------- moving actors

AWAY, NEAR = (14.0, 8.0, 0.0), (14.0, -2.0, 0.0)


def car_box(place, margin_m=0.0):
    low_m = np.array([place[0] - 2, place[1] - 1, 0.0]) - margin_m
    return low_m, low_m + (4.0, 2.0, 1.6) + 2 * np.array(margin_m)


def test_a_moving_actor_leaves_no_ghost():
    stage, returns = scanned(FINE, [ground()], [actor([AWAY, NEAR])], (0, HERE), (1, HERE))
    semantics, centers_m = stage.label(1, HERE, returns).semantics, centers_world(HERE, FINE)
    left = inside(centers_m, *car_box(AWAY, 0.3))
    now = inside(centers_m, *car_box(NEAR, 0.3))
    assert left.sum() > 100
    assert CAR not in semantics[left]
    assert (semantics[left & (centers_m[..., 2] > 0.6)] == FREE).mean() > 0.8
    assert (semantics[now] == CAR).sum() > 50
    assert (semantics == CAR).sum() == (semantics[now] == CAR).sum()


def test_where_an_actor_is_now_is_not_free_but_where_the_camera_looks_through():
    # It is scanned before it comes, when its place is free, and never again.
    stage, _ = scanned(FINE, [ground()], [actor([AWAY, NEAR])], (0, HERE))
    core = inside(centers_world(HERE, FINE), *car_box(NEAR, -0.3))
    before, after = (stage.label(step, HERE, {1: 99}).semantics[core] for step in (0, 1))
    assert (before == FREE).sum() > 20
    assert FREE not in after


def test_an_actor_s_points_go_where_it_is_and_turn_with_it():
    car = actor([(10, 3, 0), (14, -2, 0.2)])
    car.world_from_actor[1, :2, :2] = [[0, -1], [1, 0]]
    hits = ScanHits(np.array([8.0, 12.0, np.inf]), np.full(3, CAR, np.uint8), np.array([1, 1, -1]))
    actors = ActorMap()
    actors.add(Scan(np.array([0.0, 3.0, 1.0]), np.tile([1.0, 0, 0], (3, 1)), hits), [car], 0)
    actors.freeze()

    np.testing.assert_allclose(actors.placed(car, 0), [(8, 3, 1), (12, 3, 1)])
    # Its tail is now south of it, its nose north.
    np.testing.assert_allclose(actors.placed(car, 1), [(14, -4, 1.2), (14, 0, 1.2)], atol=1e-12)
    assert len(actors.placed(replace(car, actor_id=7), 0)) == 0


def test_all_sides_ever_seen_close_the_actor_of_now():
    car, far_side = actor([NEAR, NEAR]), body_at((22.0, -2.0, 5.3), yaw=np.pi)
    far_face = inside(centers_world(HERE, FINE), (15.7, -3, 0.5), (16.2, -1, 1.5))
    both_sides, returns = scanned(FINE, [ground()], [car], (0, far_side), (1, HERE))
    assert (both_sides.label(1, HERE, returns).semantics[far_face] == CAR).sum() > 4
    one_side, returns = scanned(FINE, [ground()], [car], (1, HERE))
    assert CAR not in one_side.label(1, HERE, returns).semantics[far_face]


def test_a_hidden_actor_without_support_is_unknown():
    places = (0, body_at((12.0, -2.0, 5.3))), (0, body_at((20.0, 2.0, 5.3), yaw=np.pi))
    stage, _ = scanned(FINE, [ground(), SCREEN], [actor([NEAR, NEAR])], *places)
    assert view_of(stage.scene, 1, HERE).visible_pixels == {}

    core = inside(centers_world(HERE, FINE), *car_box(NEAR, -0.3))
    unsupported = stage.label(1, HERE, {1: MIN_LIDAR_RETURNS - 1})
    assert CAR not in unsupported.semantics
    assert (unsupported.semantics[core] == UNKNOWN).all()
    supported = stage.label(1, HERE, {1: MIN_LIDAR_RETURNS})
    assert (supported.semantics == CAR).sum() > 20
    assert not supported.visible[supported.semantics == CAR].any()


def test_few_visible_pixels_are_support_enough():
    stage, _ = scanned(FINE, [ground()], [actor([AWAY, NEAR])], (0, HERE))
    view = view_of(stage.scene, 1, HERE)
    seen = view.actor_id == 1
    assert view.visible_pixels == {1: seen.sum()}
    assert seen.sum() > 50

    cars = []
    for count in (MIN_VISIBLE_PIXELS, MIN_VISIBLE_PIXELS - 1):
        mask = np.where(seen & (np.cumsum(seen).reshape(seen.shape) > count), 0, view.actor_id)
        fewer = replace(view, actor_id=mask, class_id=np.where(seen, GROUND, view.class_id))
        cars.append((stage.label(1, HERE, {}, fewer).semantics == CAR).sum())
    assert cars[0] > 10
    assert cars[1] == 0


@pytest.mark.parametrize("yaw_rad", [0.0, 0.6, np.pi / 2, -2.0])
def test_the_space_of_an_actor_is_its_box_grown_by_half_a_voxel(yaw_rad):
    here, size_m = body_at((0.3, 0.2, 5.3), 0.1, -0.2, 0.8), (6.0, 2.2, 2.8)
    bus = actor([(9.0, 5.0, 0.2)], size_m=size_m, yaw_rad=yaw_rad)
    away_m = (centers_world(here, FINE) - (9.0, 5.0, 0.2 + 1.4)) @ bus.world_from_actor[0, :3, :3]
    expected = (np.abs(away_m) <= np.array(size_m) / 2 + FINE.voxel_m / 2).all(axis=-1)
    view = view_of(Scene((), ()), 0, here)
    np.testing.assert_array_equal(space_of([bus], 0, view, FINE), expected)
    assert expected.sum() > 100


# ------------------------------------------------------------------------------ depth consistency


def test_depth_consistency_removes_what_the_camera_looks_through():
    view = view_of(Scene(parts_of([ground(), WALL]), ()), 0, HERE)
    phantom, surface, behind = (12.0, 0, 5), (19.9, 0, 5), (23.0, 0, 5)
    aside, above = (5.0, 30.0, 5), (3.0, 0.0, 60.0)
    points_m = np.array([phantom, surface, behind, aside, above])
    assert sees_through(view, points_m, 0.5).tolist() == [True, False, False, False, False]
    # The empty sky is farther than anything.
    assert sees_through(view_of(Scene((), ()), 0, HERE), points_m[:3], 0.5).all()


def test_depth_consistency_spares_silhouettes():
    view = view_of(Scene(parts_of([WALL]), ()), 0, HERE)
    across_m = np.linspace(7.0, 9.0, 41)
    points_m = np.stack([np.full(41, 19.9), across_m, np.full(41, 5.0)], axis=1)
    through = sees_through(view, points_m, 0.5)
    pixel_m = 19.5 / float(scenery.PIX_FROM_CAMERA[0, 0])
    assert not through[across_m < 8.0 + 0.4 * pixel_m].any()
    assert through[across_m > 8.0 + 2.1 * pixel_m].all()


def test_an_actor_that_left_is_not_drawn_where_the_camera_looks_through():
    """The simulator says where it is, but the camera sees the road: it gets no label there."""
    stage, returns = scanned(FINE, [ground()], [actor([AWAY, NEAR])], (0, HERE))
    labels = stage.label(1, HERE, returns, view_of(stage.scene, 0, HERE))
    centers_m = centers_world(HERE, FINE)
    above_road = inside(centers_m, *car_box(NEAR, 0.2)) & (centers_m[..., 2] > 1.0)
    assert CAR not in labels.semantics[above_road]


# ------------------------------------------------------------------------------------- the vote


def test_votes_count_points_ties_go_to_the_rarer_class_and_occupied_beats_free():
    votes = np.zeros((1, 1, 6, FREE), np.int32)
    votes[0, 0, 0, [GROUND, CAR]] = 5, 4
    votes[0, 0, 1, [GROUND, CAR]] = 5, 5
    votes[0, 0, 2, [CAR, VRU, BUILDING]] = 2, 2, 2
    votes[0, 0, 3, BUILDING] = 1
    free = np.array([[[False, False, False, True, True, False]]])
    assert elect(votes, free)[0, 0].tolist() == [GROUND, CAR, VRU, BUILDING, FREE, UNKNOWN]


# ---------------------------------------------------------------------- the frustum, and visible


def by_hand(roll, pitch):
    """Pixel and depth of every voxel center, and whether it is in the image, written out.

    In the occ frame: nose down by pitch about the left axis, then right side down by roll about
    the nose. The camera sits 0.1 m ahead and 0.05 m below the body's center.
    """
    nose = np.array([np.cos(pitch), 0, -np.sin(pitch)])
    up, left = np.array([np.sin(pitch), 0, np.cos(pitch)]), np.array([0.0, 1, 0])
    left, up = np.cos(roll) * left + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * left

    away = GRID.centers(torch.float64).numpy() - (0.1 * nose - 0.05 * up)
    depth_m = away @ nose
    width, height = scenery.WIDTH, scenery.HEIGHT
    focal = width / 2  # a field of view of 90 degrees
    with np.errstate(divide="ignore"):
        u = width / 2 - focal * (away @ left) / depth_m
        v = height / 2 - focal * (away @ up) / depth_m
    return u, v, depth_m, (depth_m > 0.1) & (u >= 0) & (u < width) & (v >= 0) & (v < height)


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw"), [(0.35, 0.0, 0.0), (-0.3, 0.2, 2.1), (0.0, -0.25, -1.0)]
)
def test_labels_stand_exactly_where_the_rolled_image_is(roll, pitch, yaw):
    """Fails if the sign of roll or pitch is flipped, or if either enters twice or not at all."""
    here = body_at((0.3, 0.2, 5.3), roll, pitch, yaw)
    stage, _ = scanned(GRID, [], [], (0, here))
    labels = stage.label(0, here, {})
    *_, expected = by_hand(roll, pitch)
    np.testing.assert_array_equal(labels.semantics == FREE, expected)
    np.testing.assert_array_equal(labels.visible, expected)
    assert (labels.semantics[~expected] == UNKNOWN).all()

    wrong_rolls = [(-roll, pitch), (2 * roll, pitch), (0.0, pitch)] if roll else []
    wrong_pitches = [(roll, -pitch), (roll, 2 * pitch), (roll, 0.0)] if pitch else []
    for wrong in wrong_rolls + wrong_pitches:
        assert (by_hand(*wrong)[-1] != expected).sum() > 50


def test_visible_is_what_the_camera_sees_now():
    here, beside = body_at((0.3, 0.2, 5.3), 0.25, 0.15, 0.4), body_at((12.0, 3.0, 5.3))
    stage, _ = scanned(GRID, [ground(), WALL, SCREEN], [], (0, here), (0, beside))
    view = view_of(stage.scene, 0, here)
    labels = stage.label(0, here, {}, view)
    semantics, visible = labels.semantics, labels.visible

    u, v, depth_m, seen = by_hand(0.25, 0.15)
    surface_m = np.zeros(GRID.shape)
    surface_m[seen] = view.depth_m[v[seen].astype(int), u[seen].astype(int)]
    seen_free = seen & (depth_m < surface_m - 3**0.5 / 2)
    free = semantics == FREE
    np.testing.assert_array_equal(visible[free], seen_free[free])
    assert free[seen_free].sum() > 300
    assert (free & ~visible).sum() > 50

    # A surface is visible where some pixel's own point lies in its voxel.
    held = np.zeros(GRID.shape, dtype=bool)
    held[pixel_voxels(view, here)] = True
    occupied = semantics < FREE
    assert (visible[occupied] == held[occupied]).mean() > 0.995
    assert visible[occupied].sum() > 50
    assert (~visible[occupied]).sum() > 50
    assert not visible[semantics == UNKNOWN].any()
