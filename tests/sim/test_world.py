"""The renderer's images beside ray casts of the same scene."""

import cv2
import numpy as np
import pytest
import torch

from src.geometry import (
    camera_from_occ,
    inverse,
    pixel_centers,
    project,
    transform,
    world_from_occ,
)
from src.ontology import BUILDING, GROUND, SKY, THIN_STRUCTURE, VEGETATION
from src.sim.camera import FAR_M
from src.sim.scene import Scene, parts_of
from src.sim.solid import Solid
from src.sim.textures import CAR_PAINT, PALETTE
from tests.sim import scenery
from tests.sim.scenery import (
    BODY_FROM_CAMERA,
    actor,
    body_at,
    ground,
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
# Two cars, which stand elsewhere at the second step; their numbers need not follow each other.
ACTORS = (
    actor([(14, 1, 0), (11, 2, 0)], actor_id=1, yaw_rad=0.4),
    actor([(12, -2, 0), (16, -1, 0)], actor_id=7),
)
SCENE = Scene(parts_of(STATIC), ACTORS)
HERE = body_at((0.5, 0.4, 6.2))
ATTITUDES = [(0.0, 0.0, 0.0), (0.3, 0.2, 0.15), (-0.35, 0.25, -0.2)]


@pytest.fixture(scope="module")
def world():
    with world_of(SCENE) as opened:
        yield opened


def interior(image):
    """Pixels whose neighbors all show the same: no silhouette runs through them."""
    padded = np.pad(image, 1, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    return (windows == image[..., None, None]).all(axis=(2, 3))


def assert_that_sky_is_empty(rendering):
    """It has neither a depth nor an actor."""
    for empty in (np.isinf(rendering.depth_m), rendering.actor_id == -1):
        np.testing.assert_array_equal(rendering.class_id == SKY, empty)


def assert_same(one, other):
    for name, values in vars(one).items():
        np.testing.assert_array_equal(values, getattr(other, name))


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize("step", [0, 1])
def test_the_picture_is_what_rays_meet(world, attitude, step):
    here = body_at((0.5, 0.4, 6.2), *attitude)
    rendering = render(world, here, step)
    truth = view_of(SCENE, step, here)
    assert (rendering.class_id == truth.class_id).mean() > 0.99
    assert (rendering.actor_id == truth.actor_id).mean() > 0.99
    assert set(np.unique(truth.actor_id)) == {-1, 0, 1, 7}
    assert_that_sky_is_empty(rendering)
    types = (rendering.rgb.dtype, rendering.depth_m.dtype, rendering.class_id.dtype)
    assert types == (np.uint8, np.float32, np.uint8)
    sure = interior(truth.actor_id) & interior(truth.class_id) & (truth.depth_m < 60)
    error_m = np.abs(rendering.depth_m[sure] - truth.depth_m[sure])
    # Creases between faces of one body are silhouettes too, which the masks do not show.
    assert np.quantile(error_m, 0.99) < 0.01
    assert sure.mean() > 0.3


def test_what_the_far_plane_cuts_off_is_sky():
    """There the mask shows a body, but its depth cannot be told from the background's."""
    here = body_at((0.0, 0.0, 6.0))
    at_m = float((here @ BODY_FROM_CAMERA)[0, 3]) + FAR_M - 0.05
    wall = solid(BUILDING, (1, 200, 50), (at_m + 0.5, 0, 10))
    with world_of(Scene(parts_of([ground(), wall]), ())) as world:
        rendering = render(world, here)
    assert BUILDING not in rendering.class_id
    assert_that_sky_is_empty(rendering)


def test_a_picture_does_not_depend_on_the_one_before(world):
    here, other = body_at((0.5, 0.4, 6.2), 0.2), body_at((3.0, 0.4, 5.0), yaw=0.4)
    first = render(world, here, 0, WEATHERS["sunset"])
    render(world, other, 1, WEATHERS["night"])
    assert_same(first, render(world, here, 0, WEATHERS["sunset"]))


@pytest.mark.parametrize("attitude", [*ATTITUDES, (0.3, 0.3, -1.2)])
def test_a_boxs_silhouette_is_the_outline_of_its_projected_corners(attitude):
    size_m, here = (3.0, 2.0, 4.0), body_at((20.0, -7.0, 9.0), *attitude)
    before_camera = torch.tensor([[0.4, -0.3, 12.0]], dtype=torch.float64)
    middle_m = transform(here @ BODY_FROM_CAMERA, before_camera)[0]
    world_from_box = body_at(middle_m.tolist(), 0.4, -0.2, 1.1)
    box = Solid("box", BUILDING, size_m, world_from_box.numpy(), "asphalt")
    with world_of(Scene(parts_of([box]), ())) as world:
        drawn = render(world, here).class_id != SKY

    # The corners take the chain through the occ frame, as the annotation does.
    occ_from_box = inverse(world_from_occ(here)) @ world_from_box
    signs = torch.cartesian_prod(*[torch.tensor([-0.5, 0.5], dtype=torch.float64)] * 3)
    corners_occ = transform(occ_from_box, signs * torch.tensor(size_m, dtype=torch.float64))
    chain = camera_from_occ(here, BODY_FROM_CAMERA)
    corners_pix, _ = project(corners_occ, chain, scenery.PIX_FROM_CAMERA)

    outline = cv2.convexHull(corners_pix.numpy().astype(np.float32))
    centers = pixel_centers(scenery.WIDTH, scenery.HEIGHT).reshape(-1, 2).tolist()
    inside = [cv2.pointPolygonTest(outline, center, measureDist=True) for center in centers]
    inside = np.reshape(inside, drawn.shape)
    assert drawn.sum() > 150
    # Only pixels whose center lies on the outline itself may be on the wrong side of it.
    wrong = drawn != (inside > 0)
    assert np.abs(inside[wrong]).max(initial=0.0) < 0.05


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
    places = [body_at(tuple(p), *a) for p, a in zip(positions_m, angles_rad)]
    scene = Scene(parts_of([ground(), *HOUSES, *TREES]), tuple(CARS))

    with world_of(scene) as world:
        culled, hidden = [], []
        for place in places:
            culled.append(render(world, place))
            hidden.append((~world._visible).mean())
        monkeypatch.setattr("src.sim.camera.in_view", lambda *args: np.ones(len(args[2]), bool))
        whole = [render(world, place) for place in places]
        assert world._visible.all()

    assert np.mean(hidden) > 0.5
    for one, other in zip(culled, whole):
        assert_same(one, other)


# --------------------------------------------------------------------------------------- EGL


@pytest.fixture
def egl(needs_egl):
    with world_of(SCENE, "egl") as opened:
        yield opened


def test_egl_gives_what_rays_meet(egl):
    here = body_at((0.5, 0.4, 6.2), 0.3, 0.2, 0.15)
    rendering = render(egl, here, 1)
    truth = view_of(SCENE, 1, here)
    assert (rendering.class_id == truth.class_id).mean() > 0.999
    assert (rendering.actor_id == truth.actor_id).mean() > 0.999
    # Beyond the far plane a ray still meets things, but nothing is drawn.
    near = truth.depth_m < 100
    assert np.abs(rendering.depth_m[near] - truth.depth_m[near]).max() < 0.01


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_egls_colors_lie_on_what_rays_meet(needs_egl, attitude):
    """Half a pixel off, the red of dozens of pixels along the outlines would be amiss."""
    boxes = [
        solid(BUILDING, (4, 3, 9), (19, 5, 4.5), yaw_rad=0.3, material=RED),
        solid(VEGETATION, (4, 4, 5), (13, -5, 4), "ellipsoid", material=RED),
        solid(THIN_STRUCTURE, (1, 1, 9), (11, 1, 4.5), "cylinder", material=RED),
    ]
    with world_of(Scene(parts_of([ground(), *boxes]), ()), "egl") as opened:
        seen = render(opened, body_at((0.5, 0.4, 6.2), *attitude), 0, WEATHERS["cloudy"])

    red, green, blue = np.moveaxis(seen.rgb.astype(int), -1, 0)
    painted = (seen.class_id != GROUND) & (seen.class_id != SKY)
    assert painted.sum() > 400
    assert ((red > 2 * np.maximum(green, blue)) != painted).sum() <= 5


def test_worlds_of_both_renderers_follow_each_other_in_silence(needs_egl, capfd):
    pictures = []
    for renderer in ("tiny", "egl", "tiny", "egl"):
        with world_of(SCENE, renderer) as opened:
            pictures.append(render(opened, HERE).rgb)
    np.testing.assert_array_equal(pictures[0], pictures[2])
    np.testing.assert_array_equal(pictures[1], pictures[3])
    assert (pictures[0] != pictures[1]).any()
    assert capfd.readouterr() == ("", "")
