"""What the renderer shows against ray casts of the same scene."""

import numpy as np
import pytest

from src.ontology import BUILDING, GROUND, SKY, THIN_STRUCTURE, VEGETATION
from src.sim.camera import FAR_M
from src.sim.scene import Scene, parts_of
from src.sim.textures import CAR_PAINT, PALETTE
from tests.sim.scenery import (
    BODY_FROM_CAMERA,
    HEIGHT,
    WIDTH,
    actor,
    ground,
    pose,
    render,
    solid,
    view_of,
    world_of,
)
from tests.sim.weathers import WEATHERS

PLAIN = PALETTE[0]
RED = CAR_PAINT[0]
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
HERE = pose((0.5, 0.4, 6.2))
ATTITUDES = [(0.0, 0.0, 0.0), (0.3, 0.2, 0.15), (-0.35, 0.25, -0.2)]


@pytest.fixture(scope="module")
def world():
    with world_of(SCENE) as opened:
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
    rendering = render(world, here, step)
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
    rendering = render(world, here)
    assert (rendering.class_id == view_of(SCENE, 0, other).class_id).mean() < 0.97


def test_the_sky_has_no_depth_no_class_and_no_actor(world):
    here = pose((0.0, 0.0, 6.0), pitch=-0.3)
    rendering = render(world, here)
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
    with world_of(Scene(parts_of([ground(), wall]), ())) as world:
        rendering = render(world, here)
    assert BUILDING not in rendering.class_id
    np.testing.assert_array_equal(rendering.class_id == SKY, np.isinf(rendering.depth_m))
    np.testing.assert_array_equal(rendering.actor_id == -1, np.isinf(rendering.depth_m))


def test_a_picture_does_not_depend_on_the_one_before(world):
    here, other = pose((0.5, 0.4, 6.2), 0.2), pose((3.0, 0.4, 5.0), yaw=0.4)
    first = render(world, here, 0, WEATHERS["sunset"])
    render(world, other, 1, WEATHERS["night"])
    again = render(world, here, 0, WEATHERS["sunset"])
    for name in ("rgb", "depth_m", "class_id", "actor_id"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


# ----------------------------------------------------------------------------------- culling


def around(radius_m, height_m, step_rad):
    """Places on a circle, and the angles at which they lie."""
    angles_rad = np.arange(0, 6.2, step_rad)
    return [((radius_m * np.cos(a), radius_m * np.sin(a), height_m), a) for a in angles_rad]


HOUSES = [solid(BUILDING, (6, 9, 12), at_m, yaw_rad=a) for at_m, a in around(40, 6, 0.4)]
TREES = [solid(VEGETATION, (3, 3, 4), at_m, "cone", 0.0, PLAIN) for at_m, _ in around(70, 3, 0.15)]
CARS = [actor([at_m], actor_id=1 + k, yaw_rad=a) for k, (at_m, a) in enumerate(around(18, 0, 0.5))]


def test_hiding_what_is_out_of_sight_changes_no_pixel(monkeypatch):
    rng = np.random.default_rng(0)
    positions_m = rng.uniform((-30, -30, 2), (30, 30, 18), (24, 3))
    angles_rad = rng.uniform((-0.5, -0.5, -np.pi), (0.5, 0.5, np.pi), (24, 3))
    poses = [pose(tuple(p), *a) for p, a in zip(positions_m, angles_rad)]
    scene = Scene(parts_of([ground(), *HOUSES, *TREES]), tuple(CARS))
    with world_of(scene) as world:
        culled, hidden = [], []
        for place in poses:
            culled.append(render(world, place))
            hidden.append((~world._shown).mean())
        monkeypatch.setattr("src.sim.world.in_view", lambda *args: np.ones(len(args[2]), bool))
        whole = [render(world, place) for place in poses]
        assert world._shown.all()
    assert np.mean(hidden) > 0.5
    for one, other in zip(culled, whole):
        for name in ("rgb", "depth_m", "class_id", "actor_id"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_what_is_hidden_is_not_drawn_and_comes_back(monkeypatch):
    with world_of(SCENE) as world:
        before = render(world, HERE)
        monkeypatch.setattr("src.sim.world.in_view", lambda *args: np.zeros(len(args[2]), bool))
        nothing = render(world, HERE)
        monkeypatch.undo()
        after = render(world, HERE)
    assert (nothing.class_id == SKY).all()
    assert (nothing.rgb == 255).all()
    np.testing.assert_array_equal(before.rgb, after.rgb)


# --------------------------------------------------------------------------------------- EGL


@pytest.fixture
def egl(needs_egl):
    with world_of(SCENE, "egl") as opened:
        yield opened


def test_egl_gives_what_rays_meet(egl):
    here = pose((0.5, 0.4, 6.2), 0.3, 0.2, 0.15)
    rendering = render(egl, here, 1)
    truth = view_of(SCENE, 1, here)
    assert (rendering.class_id == truth.class_id).mean() > 0.999
    assert (rendering.actor_id == truth.actor_id).mean() > 0.999
    near = truth.depth_m < 100
    assert np.abs(rendering.depth_m[near] - truth.depth_m[near]).max() < 0.01


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_egls_colours_lie_on_what_rays_meet(needs_egl, attitude):
    """Half a pixel off, the red of dozens of pixels along the outlines would be amiss."""
    solids = [
        solid(BUILDING, (4, 3, 9), (19, 5, 4.5), yaw_rad=0.3, material=RED),
        solid(VEGETATION, (4, 4, 5), (13, -5, 4), "ellipsoid", material=RED),
        solid(THIN_STRUCTURE, (1, 1, 9), (11, 1, 4.5), "cylinder", material=RED),
    ]
    here = pose((0.5, 0.4, 6.2), *attitude)
    scene = Scene(parts_of([ground(), *solids]), ())
    with world_of(scene, "egl") as opened:
        seen = render(opened, here, 0, WEATHERS["cloudy"])
    red, green, blue = np.moveaxis(seen.rgb.astype(int), -1, 0)
    painted = (seen.class_id != GROUND) & (seen.class_id != SKY)
    assert painted.sum() > 400
    assert ((red > 2 * np.maximum(green, blue)) != painted).sum() <= 5


def test_egl_draws_much_the_same_as_tiny_renderer(egl, world):
    here = pose((0.5, 0.4, 6.2), 0.1, 0.1, 0.1)
    for weather in ("clear", "sunset", "night"):
        one, other = (render(each, here, 0, WEATHERS[weather]) for each in (egl, world))
        difference = np.abs(one.rgb.astype(int) - other.rgb).mean(axis=-1)
        assert difference.mean() < 12


def test_worlds_of_both_renderers_follow_each_other_in_silence(needs_egl, capfd):
    pictures = []
    for renderer in ("tiny", "egl", "tiny", "egl"):
        with world_of(SCENE, renderer) as opened:
            pictures.append(render(opened, HERE).rgb)
    np.testing.assert_array_equal(pictures[0], pictures[2])
    np.testing.assert_array_equal(pictures[1], pictures[3])
    assert (pictures[0] != pictures[1]).any()
    assert capfd.readouterr() == ("", "")


def test_a_second_world_with_egl_is_refused_while_one_is_open(egl):
    before = render(egl, HERE).rgb
    with pytest.raises(RuntimeError, match="one world at a time"), world_of(SCENE, "egl"):
        pass
    np.testing.assert_array_equal(before, render(egl, HERE).rgb)


def test_a_world_that_could_not_be_filled_is_closed(needs_egl, monkeypatch):
    monkeypatch.setattr("src.sim.drawing._obj", lambda *mesh: 1 / 0)
    with pytest.raises(ZeroDivisionError), world_of(SCENE, "egl"):
        pass
    monkeypatch.undo()
    with world_of(SCENE, "egl"):
        pass
