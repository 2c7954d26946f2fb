"""The images of pybullet beside what `geometry.project` gives, at rolled and pitched attitudes."""

import cv2
import numpy as np
import pytest
import torch

from src import geometry as g
from src.sim import camera
from src.sim.camera import FAR_M, NEAR_M, SAMPLE_OFFSET_PIX
from src.sim.drawing import Drawing
from src.sim.mesh import mesh_of_solid
from src.sim.solid import Solid
from tests.sim.scenery import body_at
from tests.sim.weathers import WEATHERS

WIDTH, HEIGHT = 224, 128
PIX_FROM_CAMERA = g.pinhole(WIDTH, HEIGHT, np.deg2rad(90.0))
BODY_FROM_CAMERA = g.front_mount((0.12, 0.03, -0.05), pitch_rad=0.1)
PLANE_HALF_M = 70.0
HEIGHT_M = 8.3
BOX_SIZE_M = (3.0, 2.0, 4.0)
LEVEL, TILTED = (0.0, 0.0, 0.0), (0.2, 0.15, 0.7)
ATTITUDES = pytest.mark.parametrize(
    "attitude_rad", [LEVEL, TILTED, (-0.35, -0.1, 2.0), (0.3, 0.3, -1.2)]
)


@pytest.fixture
def tiny():
    drawing = Drawing("tiny")
    yield drawing
    drawing.close()


@pytest.fixture
def egl(needs_egl):
    drawing = Drawing("egl")
    yield drawing
    drawing.close()


def add_box(drawing, size_m, world_from_box):
    mesh = mesh_of_solid(Solid("box", 0, size_m, world_from_box.numpy(), "asphalt"))
    drawing.add(mesh, mesh.uvs_m, "asphalt")


def add_ground(drawing):
    """A slab whose top is world z = 0."""
    add_box(drawing, (2 * PLANE_HALF_M, 2 * PLANE_HALF_M, 1.0), body_at((0.0, 0.0, -0.5)))


def render(drawing, world_from_body, offset_pix=SAMPLE_OFFSET_PIX["tiny"]):
    """Depth in metres and bullet ids (-1 where nothing is hit), both (height, width)."""
    lens = PIX_FROM_CAMERA, WIDTH, HEIGHT, NEAR_M, FAR_M
    view = camera.view_matrix(g.inverse(world_from_body @ BODY_FROM_CAMERA))
    projection = camera.projection_matrix(*lens, offset_pix)
    light = WEATHERS["clear"].light()
    _, buffer, bullet_id = drawing.picture(WIDTH, HEIGHT, view, projection, light)
    return camera.depth_from_buffer(buffer, NEAR_M, FAR_M), bullet_id


def ground_depth(world_from_body):
    """Analytic z-depth of z = 0 at the pixels' centers, and how far from the slab's middle it is.

    The depth is negative above the horizon.
    """
    occ_from_camera = g.inverse(g.camera_from_occ(world_from_body, BODY_FROM_CAMERA))
    world_from_camera = g.world_from_occ(world_from_body) @ occ_from_camera
    pix = g.pixel_centers(WIDTH, HEIGHT)
    rays_camera = g.unproject(pix, torch.ones_like(pix[..., 0]), PIX_FROM_CAMERA)
    fall = -(rays_camera @ world_from_camera[:3, :3].T)[..., 2]
    depth_m = world_from_camera[2, 3] / fall
    hits_world = g.transform(world_from_camera, rays_camera * depth_m[..., None])
    return depth_m.numpy(), hits_world[..., :2].abs().amax(dim=-1).numpy()


def ground_error(drawing, attitude_rad, offset_pix=SAMPLE_OFFSET_PIX["tiny"]):
    """By how much the ground is rendered too far, and its true depth, where that is within 50 m."""
    add_ground(drawing)
    world_from_body = body_at((1.0, 2.0, HEIGHT_M), *attitude_rad)
    depth_m, _ = render(drawing, world_from_body, offset_pix)
    expected_m, radius_m = ground_depth(world_from_body)

    # One pixel spans metres of ground near the horizon, so the slab's border needs a margin.
    checked = (expected_m > 0) & (expected_m < 50) & (radius_m < PLANE_HALF_M - 10)
    assert checked.sum() > 5000
    return (depth_m - expected_m)[checked], expected_m[checked]


@ATTITUDES
def test_tiny_renderer_sees_the_ground_where_the_chain_puts_it(tiny, attitude_rad):
    error_m, _ = ground_error(tiny, attitude_rad)
    assert np.abs(error_m).max() < 0.01


@pytest.mark.parametrize("attitude_rad", [LEVEL, TILTED])
def test_egl_samples_at_pixel_centers(egl, attitude_rad):
    error_m, depth_m = ground_error(egl, attitude_rad, SAMPLE_OFFSET_PIX["egl"])
    # Its depth buffer may have 16 bits only; a step of that is z^2 / near / 2^16.
    assert (np.abs(error_m) < depth_m**2 / NEAR_M / 2**16 + 0.01).all()
    assert np.median(np.abs(error_m)) < 0.03


# -------------------------------------------------------------------------------------- a box


def misjudged_pix(drawing, attitude_rad):
    """The largest distance, from the outline of a box's projected corners, of the center of a
    pixel that is on the wrong side of it."""
    world_from_body = body_at((20.0, -7.0, 9.0), *attitude_rad)
    before_camera = torch.tensor([[0.4, -0.3, 12.0]], dtype=torch.float64)
    middle_m = g.transform(world_from_body @ BODY_FROM_CAMERA, before_camera)[0]
    world_from_box = body_at(middle_m.tolist(), 0.4, -0.2, 1.1)
    add_box(drawing, BOX_SIZE_M, world_from_box)
    _, bullet_id = render(drawing, world_from_body)

    # The corners take the chain through the occ frame, as the annotation does.
    occ_from_box = g.inverse(g.world_from_occ(world_from_body)) @ world_from_box
    camera_from_box = g.camera_from_occ(world_from_body, BODY_FROM_CAMERA) @ occ_from_box
    signs = torch.cartesian_prod(*[torch.tensor([-0.5, 0.5], dtype=torch.float64)] * 3)
    corners_box = signs * torch.tensor(BOX_SIZE_M, dtype=torch.float64)
    corners_pix, _ = g.project(corners_box, camera_from_box, PIX_FROM_CAMERA)

    outline = cv2.convexHull(corners_pix.numpy().astype(np.float32))
    centers = g.pixel_centers(WIDTH, HEIGHT).reshape(-1, 2).tolist()
    inside = [cv2.pointPolygonTest(outline, center, measureDist=True) for center in centers]
    inside = np.reshape(inside, (HEIGHT, WIDTH))
    assert (inside > 0).sum() > 300
    wrong = (bullet_id >= 0) != (inside > 0)
    return np.abs(inside[wrong]).max(initial=0.0)


@ATTITUDES
def test_a_boxs_silhouette_is_the_outline_of_its_projected_corners(tiny, attitude_rad):
    assert misjudged_pix(tiny, attitude_rad) < 0.05
