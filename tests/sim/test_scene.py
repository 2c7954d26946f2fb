"""The hits of rays in a scene, and the actors on a real town's surfaces."""

import numpy as np
import pytest

from src.ontology import BUILDING, CAR, GROUND, UNKNOWN, VEGETATION
from src.sim.layout import GroundPatch, Town
from src.sim.scene import PATCH_M, Scene, parts_of, pieces_of, static_parts
from src.sim.towns import build_town
from tests.sim.scenery import actor, ground, solid

DOWN, EAST, WEST = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
WALL = solid(BUILDING, (1.0, 20.0, 8.0), (30.5, 0, 4))
STATIC = parts_of([ground(), WALL])
BEHIND_M = np.array([8.0, 0, 0])
PLACES_M = np.array([(10.0, 0, 0), (20.0, 0, 0), (40.0, 0, 0)])


def cast(scene, step, *rays):
    origins_m, directions = (np.array(columns, dtype=float) for columns in zip(*rays))
    return scene.cast(step, origins_m, directions)


def test_every_ray_meets_what_is_nearest_and_its_class():
    scene = Scene(STATIC, (actor(PLACES_M), actor(PLACES_M + BEHIND_M, actor_id=2)))
    level = (((0, 0, 1), EAST), ((29, 0, 1), WEST), ((0, 5, 1), EAST), ((0, 0, 9), EAST))
    hits = cast(scene, 0, *level, ((3, 0, 7), DOWN))
    assert hits.distance_m == pytest.approx([8, 9, 30, np.inf, 7], abs=1e-4)
    assert hits.class_id.tolist() == [CAR, CAR, BUILDING, UNKNOWN, GROUND]
    assert hits.actor_id.tolist() == [1, 2, 0, -1, 0]


def test_an_actor_is_where_it_is_at_that_step():
    scene = Scene(STATIC, (actor(PLACES_M),))
    ahead = ((0, 0, 1), EAST)
    hits = [cast(scene, step, ahead) for step in range(3)]
    assert [float(at.distance_m[0]) for at in hits] == pytest.approx([8, 18, 30], abs=1e-4)
    assert [int(at.actor_id[0]) for at in hits] == [1, 1, 0]
    origin_m, direction = np.array([[0.0, 0, 1]]), np.array([EAST])
    assert scene.cast_static(origin_m, direction) == pytest.approx([30], abs=1e-4)


@pytest.mark.parametrize("towards", [(0.0, 0.0, 1.0), (0.6, 0.64, 0.48), (-0.9, 0.4, 0.17)])
def test_light_is_blocked_where_a_ray_to_it_meets_anything(towards):
    towards = np.array(towards) / np.linalg.norm(towards)
    rng = np.random.default_rng(0)
    places_m = [rng.uniform((-25, -25, 0), (25, 25, 0), (2, 3)) for _ in range(30)]
    places_m.append([np.array([6.0, -20.0, 9.0])] * 2)  # on a bridge
    scene = Scene(STATIC, tuple(actor(p, actor_id=1 + k) for k, p in enumerate(places_m)))
    points_m = np.c_[rng.uniform(-12, 12, (3000, 2)), rng.uniform(0.05, 2, 3000)]
    for step in (0, 1):
        blocked = scene.blocked(step, points_m, towards)
        met = scene.cast(step, points_m, np.tile(towards, (3000, 1)))
        np.testing.assert_array_equal(blocked, np.isfinite(met.distance_m))
        assert 0.02 < blocked.mean() < 0.98
        assert (met.actor_id > 0).any()


def test_only_what_is_near_the_way_is_kept():
    far = solid(VEGETATION, (2.0, 2.0, 2.0), (70, 0, 1))
    patch = GroundPatch((0, 0), 0.0, 200.0, 10.0, 0.0, "asphalt")
    town = Town("t", lambda x, y: 0 * x, (WALL, far), (patch,), (), (), ())
    # The road of 200 m is one patch, which is cut; pieces within 30 m stay whole.
    pieces = pieces_of(town)
    whole, near = (
        {part.class_id: part.mesh for part in parts}
        for parts in (static_parts(pieces), static_parts(pieces, np.zeros((1, 2)), 30.0))
    )
    assert set(whole) == {BUILDING, GROUND, VEGETATION}
    assert set(near) == {BUILDING, GROUND}
    assert 30 <= np.abs(near[GROUND].vertices_m[:, 0]).max() <= 30 + PATCH_M
    assert np.abs(whole[GROUND].vertices_m[:, 0]).max() == pytest.approx(100)


def test_paths_lie_on_the_surface_that_actors_are_put_on():
    town = build_town("park", np.random.default_rng(0))
    surface = Scene(static_parts([p for p in pieces_of(town) if p.class_id == GROUND]), ())
    for paths in (town.lanes, town.walks):
        points_m = np.concatenate([path.points_m[:-1] for path in paths])
        steps_m = np.concatenate([np.diff(path.points_m, axis=0) for path in paths])
        rise_m = np.concatenate([np.full(len(p.points_m) - 1, p.rise_m) for p in paths])
        middle_m = points_m + steps_m / 2
        origins_m = np.c_[middle_m, np.full(len(middle_m), 50.0)]
        down = np.tile(DOWN, (len(middle_m), 1)).astype(float)
        height_m = 50 - surface.cast_static(origins_m, down)
        # Between its corners the ground is flat, so a path may leave it by a little.
        above_m = town.terrain(*middle_m.T) + rise_m - height_m
        assert np.abs(above_m).max() < 0.13
        assert np.quantile(np.abs(above_m), 0.8) < 0.05
