"""The two LiDARs."""

import numpy as np
import pytest

from src.ontology import BUILDING, GROUND, UNKNOWN
from src.sim.scene import Scene, parts_of
from src.sim.sensors import LIDARS, scan
from tests.sim.scenery import actor, body_at, ground, solid

WALL = solid(BUILDING, (1.0, 60.0, 20.0), (25.5, 0, 10))


def random_directions(count):
    directions = np.random.default_rng(0).standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def nearest_angle_deg(directions, wanted):
    return np.degrees(np.arccos(np.clip(wanted @ directions.T, -1, 1).max(axis=1)))


def test_together_they_see_every_direction():
    wanted = random_directions(2000)
    seen = [lidar.directions(2000, scan=0) for lidar in LIDARS]
    assert nearest_angle_deg(np.concatenate(seen), wanted).max() < 5
    # Each alone is blind to the side of the other.
    for alone in seen:
        assert nearest_angle_deg(alone, wanted).max() > 30


def test_hits_lie_on_the_known_surfaces():
    scene = Scene(parts_of([ground(), WALL]), (actor([(10.0, 4.0, 0.0)], yaw_rad=0.5),))
    world_from_body = body_at((1.0, 2.0, 6.0), 0.3, 0.2, 0.9)
    for each in scan(scene, 0, world_from_body.numpy(), 6000, 3, 60.0):
        class_id = each.hits.class_id
        floor_m, wall_m = each.points_m(class_id == GROUND), each.points_m(class_id == BUILDING)
        assert floor_m[:, 2] == pytest.approx(0, abs=1e-3)
        face = np.abs(wall_m[:, 0] - 25) < 1e-3
        assert (face | (np.abs(wall_m[:, 2] - 20) < 1e-3)).all()
        assert min(len(floor_m), face.sum()) > 50

        # In the actor's own frame its box has half sides of 2, 1 and 0.8 m.
        x, y, z = (each.points_m(each.hits.actor_id == 1) - (10, 4, 0)).T
        along, across = np.cos(0.5) * x + np.sin(0.5) * y, np.cos(0.5) * y - np.sin(0.5) * x
        faces = np.stack([np.abs(along) - 2, np.abs(across) - 1, np.abs(z - 0.8) - 0.8])
        assert faces.max(axis=0) == pytest.approx(0, abs=1e-3)


def test_they_are_mounted_above_and_below_the_tilted_body():
    world_from_body = body_at((1.0, 2.0, 6.0), roll=np.pi / 2)
    top, bottom = scan(Scene((), ()), 0, world_from_body.numpy(), 10, 0, 60.0)
    # Right side down: the body's top points to its right, which is -y at yaw 0.
    assert top.origin_m == pytest.approx([1, 1.85, 6])
    assert bottom.origin_m == pytest.approx([1, 2.15, 6])


def test_beyond_the_range_there_is_no_return():
    scene = Scene(parts_of([ground(size_m=400)]), ())
    for each in scan(scene, 0, body_at((0, 0, 10.0)).numpy(), 3000, 0, 20.0):
        slant_m = each.origin_m[2] / np.maximum(-each.directions[:, 2], 1e-9)
        none = slant_m > 20
        assert np.isinf(each.hits.distance_m[none]).all()
        assert (each.hits.class_id[none] == UNKNOWN).all()
        assert (each.hits.actor_id[none] == -1).all()
        assert each.hits.distance_m[~none] == pytest.approx(slant_m[~none], rel=1e-4)
        assert none.any()
