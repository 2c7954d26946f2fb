"""What the renderer shows against ray casts of the same scene."""

import subprocess
import sys

import numpy as np
import pytest

from src.errors import UserError
from src.ontology import BUILDING, SKY, THIN_STRUCTURE, VEGETATION
from src.sim.camera import FAR_M
from src.sim.scene import Scene, parts_of
from src.sim.textures import PALETTE
from src.sim.weather import WEATHERS
from src.sim.world import World, import_bullet
from tests.sim.scenery import (
    BODY_FROM_CAMERA,
    HEIGHT,
    PIX_FROM_CAMERA,
    WIDTH,
    actor,
    ground,
    pose,
    solid,
    view_of,
)

PLAIN = PALETTE[0]
STATIC = (
    ground(),
    solid(BUILDING, (4, 14, 9), (24, 3, 4.5), yaw_rad=0.3),
    solid(VEGETATION, (4, 4, 5), (13, -5, 4), "ellipsoid", material=PLAIN),
    solid(VEGETATION, (3, 3, 6), (10, 6, 3), "cone", material=PLAIN),
    solid(THIN_STRUCTURE, (0.5, 0.5, 7), (9, -1, 3.5), "cylinder", material=PLAIN),
)
ACTORS = (
    actor([(14, 1, 0), (11, 2, 0)], actor_id=1, yaw_rad=0.4),
    actor([(12, -2, 0), (16, -1, 0)], actor_id=7),
)
SCENE = Scene(parts_of(STATIC), ACTORS)
ATTITUDES = [(0.0, 0.0, 0.0), (0.3, 0.2, 0.15), (-0.35, 0.25, -0.2)]


@pytest.fixture(scope="module")
def world():
    with World(SCENE, PIX_FROM_CAMERA, WIDTH, HEIGHT) as opened:
        yield opened


def interior(image):
    """Pixels whose neighbours all show the same: no silhouette runs through them."""
    padded = np.pad(image, 1, mode="edge")
    shifted = [padded[i : i + HEIGHT, j : j + WIDTH] for i in range(3) for j in range(3)]
    return (np.stack(shifted) == image).all(axis=0)


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize("step", [0, 1])
def test_the_picture_is_what_rays_meet(world, attitude, step):
    here = pose((0.5, 0.4, 6.2), *attitude)
    rendering = world.render(step, here @ BODY_FROM_CAMERA, WEATHERS["clear"])
    truth = view_of(SCENE, step, here)
    assert (rendering.class_id == truth.class_id).mean() > 0.99
    assert (rendering.actor_id == truth.actor_id).mean() > 0.99
    assert set(np.unique(truth.actor_id)) == {-1, 0, 1, 7}
    sure = interior(truth.actor_id) & interior(truth.class_id) & (truth.depth_m < 60)
    error_m = np.abs(rendering.depth_m[sure] - truth.depth_m[sure])
    # Creases between faces of one body are silhouettes too, which the masks do not show.
    assert np.quantile(error_m, 0.99) < 0.01
    assert sure.mean() > 0.3


def test_another_attitude_would_not_do(world):
    here, other = (pose((0.5, 0.4, 6.2), roll, 0.1, 0.1) for roll in (0.15, -0.15))
    rendering = world.render(0, here @ BODY_FROM_CAMERA, WEATHERS["clear"])
    assert (rendering.class_id == view_of(SCENE, 0, other).class_id).mean() < 0.97


def test_the_sky_has_no_depth_no_class_and_no_actor(world):
    here = pose((0.0, 0.0, 6.0), pitch=-0.3)
    rendering = world.render(0, here @ BODY_FROM_CAMERA, WEATHERS["clear"])
    sky = rendering.class_id == SKY
    assert 0.2 < sky.mean() < 0.9
    np.testing.assert_array_equal(sky, np.isinf(rendering.depth_m))
    np.testing.assert_array_equal(sky, rendering.actor_id == -1)
    types = (rendering.rgb.dtype, rendering.depth_m.dtype, rendering.class_id.dtype)
    assert types == (np.uint8, np.float32, np.uint8)


def test_what_the_far_plane_cuts_off_is_sky():
    """There the mask shows a body, but its depth cannot be told from the background's."""
    here = pose((0.0, 0.0, 6.0))
    at_m = float((here @ BODY_FROM_CAMERA)[0, 3]) + FAR_M - 0.05
    wall = solid(BUILDING, (1, 200, 50), (at_m + 0.5, 0, 10))
    with World(Scene(parts_of([ground(), wall]), ()), PIX_FROM_CAMERA, WIDTH, HEIGHT) as world:
        rendering = world.render(0, here @ BODY_FROM_CAMERA, WEATHERS["clear"])
    assert BUILDING not in rendering.class_id
    np.testing.assert_array_equal(rendering.class_id == SKY, np.isinf(rendering.depth_m))
    np.testing.assert_array_equal(rendering.actor_id == -1, np.isinf(rendering.depth_m))


def test_a_picture_does_not_depend_on_the_one_before(world):
    here, other = pose((0.5, 0.4, 6.2), 0.2), pose((3.0, 0.4, 5.0), yaw=0.4)
    first = world.render(0, here @ BODY_FROM_CAMERA, WEATHERS["sunset"])
    world.render(1, other @ BODY_FROM_CAMERA, WEATHERS["night"])
    again = world.render(0, here @ BODY_FROM_CAMERA, WEATHERS["sunset"])
    for name in ("rgb", "depth_m", "class_id", "actor_id"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_without_pybullet_the_way_out_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(UserError, match=r"pybullet is not installed.*3\.11") as error:
        import_bullet()
    assert "\n" not in str(error.value)
    with pytest.raises(UserError, match="pybullet"):
        World(SCENE, PIX_FROM_CAMERA, WIDTH, HEIGHT)


def test_importing_bullet_says_nothing():
    words = [sys.executable, "-c", "from src.sim.world import import_bullet; import_bullet()"]
    done = subprocess.run(words, capture_output=True, check=True)
    assert done.stdout == done.stderr == b""
