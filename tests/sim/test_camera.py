"""What pybullet renders against what `geometry.project` says, at rolled and pitched poses."""

import importlib.util
import subprocess
import sys
from collections.abc import Iterator

import cv2
import numpy as np
import pybullet
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from src import geometry as g
from src.sim.camera import (
    FAR_M,
    NEAR_M,
    SAMPLE_OFFSET_PIX,
    depth_from_buffer,
    frustum_planes,
    in_view,
    projection_matrix,
    view_matrix,
)

WIDTH, HEIGHT = 224, 128
PIX_FROM_CAMERA = g.pinhole(WIDTH, HEIGHT, np.deg2rad(90.0))
BODY_FROM_CAMERA = g.front_mount((0.12, 0.03, -0.05), pitch_rad=0.1)
PLANE_HALF_M = 70.0
BOX_SIZE_M = (3.0, 2.0, 4.0)
ATTITUDES = [(0.0, 0.0, 0.0), (0.2, 0.15, 0.7), (-0.35, -0.1, 2.0), (0.3, 0.3, -1.2)]
UNCORRECTED = (0.0, 0.0)


def pose(
    attitude_rad: tuple[float, float, float], position_m: tuple[float, float, float]
) -> Float[Tensor, "4 4"]:
    """world_from_body."""
    angles = torch.tensor(attitude_rad, dtype=torch.float64)
    rotation = g.rotation_from_euler(*angles)
    return g.rigid(rotation, torch.tensor(position_m, dtype=torch.float64))


@pytest.fixture
def tiny() -> Iterator[int]:
    client = pybullet.connect(pybullet.DIRECT)
    yield client
    pybullet.disconnect(client)


LOAD_EGL = """
import importlib.util, pybullet
client = pybullet.connect(pybullet.DIRECT)
plugin = importlib.util.find_spec("eglRenderer").origin
assert pybullet.loadPlugin(plugin, "_eglRendererPlugin", physicsClientId=client) >= 0
"""


@pytest.fixture(scope="module")
def egl_plugin() -> str:
    """Path of the plugin; the probe is a process of its own, for a failed load ends the process."""
    probe = subprocess.run([sys.executable, "-c", LOAD_EGL], capture_output=True, check=False)
    if probe.returncode != 0:
        pytest.skip("pybullet's EGL plugin does not load on this machine")
    return importlib.util.find_spec("eglRenderer").origin


@pytest.fixture
def egl(egl_plugin: str) -> Iterator[int]:
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.loadPlugin(egl_plugin, "_eglRendererPlugin", physicsClientId=client)
    yield client
    pybullet.disconnect(client)


def add_box(
    client: int, size_m: tuple[float, float, float], world_from_box: Float[Tensor, "4 4"]
) -> None:
    roll_pitch_yaw = [float(angle) for angle in g.euler_from_rotation(world_from_box[:3, :3])]
    shape = pybullet.createVisualShape(
        pybullet.GEOM_BOX, halfExtents=[side / 2 for side in size_m], physicsClientId=client
    )
    pybullet.createMultiBody(
        baseVisualShapeIndex=shape,
        basePosition=world_from_box[:3, 3].tolist(),
        baseOrientation=pybullet.getQuaternionFromEuler(roll_pitch_yaw),
        physicsClientId=client,
    )


def add_ground(client: int) -> None:
    """A slab whose top is world z = 0."""
    size_m = (2 * PLANE_HALF_M, 2 * PLANE_HALF_M, 1.0)
    add_box(client, size_m, pose((0.0, 0.0, 0.0), (0.0, 0.0, -0.5)))


def render(
    client: int,
    world_from_body: Float[Tensor, "4 4"],
    renderer: str = "tiny",
    sample_offset_pix: tuple[float, float] | None = None,
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Depth in metres and body ids (-1 where nothing is hit)."""
    offset = SAMPLE_OFFSET_PIX[renderer] if sample_offset_pix is None else sample_offset_pix
    camera_from_world = g.inverse(world_from_body @ BODY_FROM_CAMERA)
    flags = {
        "tiny": pybullet.ER_TINY_RENDERER,
        "egl": pybullet.ER_BULLET_HARDWARE_OPENGL,
    }
    _, _, _, buffer, bodies = pybullet.getCameraImage(
        WIDTH,
        HEIGHT,
        viewMatrix=view_matrix(camera_from_world),
        projectionMatrix=projection_matrix(PIX_FROM_CAMERA, WIDTH, HEIGHT, NEAR_M, FAR_M, offset),
        renderer=flags[renderer],
        shadow=0,
        physicsClientId=client,
    )
    depth_m = depth_from_buffer(np.reshape(buffer, (HEIGHT, WIDTH)), NEAR_M, FAR_M)
    return depth_m, np.reshape(bodies, (HEIGHT, WIDTH))


def ground_depth(
    world_from_body: Float[Tensor, "4 4"],
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Analytic z-depth of z = 0 at the pixels' centres, and how far from the slab's middle it is.

    The depth is negative above the horizon.
    """
    occ_from_camera = g.inverse(g.camera_from_occ(world_from_body, BODY_FROM_CAMERA))
    pix = g.pixel_centres(WIDTH, HEIGHT).reshape(-1, 2)
    rays_camera = g.unproject(pix, torch.ones_like(pix[:, 0]), PIX_FROM_CAMERA)
    rays_occ = rays_camera @ occ_from_camera[:3, :3].T
    altitude_m = world_from_body[2, 3]
    depth_m = -(altitude_m + occ_from_camera[2, 3]) / rays_occ[:, 2]
    hits_occ = g.transform(occ_from_camera, rays_camera * depth_m[:, None])
    hits_world = g.transform(g.world_from_occ(world_from_body), hits_occ)
    radius_m = hits_world[:, :2].abs().amax(dim=-1)
    return depth_m.reshape(HEIGHT, WIDTH).numpy(), radius_m.reshape(HEIGHT, WIDTH).numpy()


def ground_error(
    client: int,
    attitude_rad: tuple[float, float, float],
    renderer: str = "tiny",
    sample_offset_pix: tuple[float, float] | None = None,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Absolute error of the rendered ground's depth, and that depth, where it is within 50 m."""
    add_ground(client)
    world_from_body = pose(attitude_rad, (1.0, 2.0, 8.3))
    depth_m, _ = render(client, world_from_body, renderer, sample_offset_pix)
    expected_m, radius_m = ground_depth(world_from_body)
    # One pixel spans metres of ground near the horizon, so the slab's border needs a margin.
    checked = (expected_m > 0) & (expected_m < 50) & (radius_m < PLANE_HALF_M - 10)
    assert checked.sum() > 5000
    return np.abs(depth_m - expected_m)[checked], expected_m[checked]


@pytest.mark.parametrize("attitude_rad", ATTITUDES)
def test_tiny_renderer_sees_the_ground_where_the_chain_puts_it(
    tiny: int, attitude_rad: tuple[float, float, float]
) -> None:
    error_m, _ = ground_error(tiny, attitude_rad)
    assert error_m.max() < 0.01


@pytest.mark.parametrize("offset", [UNCORRECTED, (0.5, -0.5), (-0.5, -0.5), (0.5, 0.5)])
def test_every_other_sample_offset_misses_the_ground(
    tiny: int, offset: tuple[float, float]
) -> None:
    error_m, _ = ground_error(tiny, (0.2, 0.15, 0.7), sample_offset_pix=offset)
    assert error_m.max() > 0.1


def test_without_the_correction_ground_at_29_m_is_15_cm_too_high(tiny: int) -> None:
    add_ground(tiny)
    world_from_body = pose((0.0, 0.0, 0.0), (0.0, 0.0, 8.0))
    camera_height_m = (world_from_body @ BODY_FROM_CAMERA)[2, 3]
    pix = g.pixel_centres(WIDTH, HEIGHT)[:, WIDTH // 2]
    heights_m = {}
    for name, offset in (("corrected", SAMPLE_OFFSET_PIX["tiny"]), ("uncorrected", UNCORRECTED)):
        depth_m, _ = render(tiny, world_from_body, sample_offset_pix=offset)
        column_m = torch.from_numpy(depth_m[:, WIDTH // 2].copy())
        row = int((column_m - 29.0).abs().argmin())
        point_camera = g.unproject(pix[row : row + 1], column_m[row : row + 1], PIX_FROM_CAMERA)
        height_m = (BODY_FROM_CAMERA[:3, :3] @ point_camera[0])[2] + camera_height_m
        heights_m[name] = float(height_m)
    assert abs(heights_m["corrected"]) < 0.01
    assert 0.1 < heights_m["uncorrected"] < 0.2


@pytest.mark.parametrize("attitude_rad", ATTITUDES[:2])
def test_egl_samples_at_pixel_centres(egl: int, attitude_rad: tuple[float, float, float]) -> None:
    error_m, depth_m = ground_error(egl, attitude_rad, "egl")
    # Its depth buffer may have 16 bits only; a step of that is z^2 / near / 2^16.
    assert (error_m < depth_m**2 / NEAR_M / 2**16 + 0.01).all()
    assert np.median(error_m) < 0.03


def test_egl_with_tiny_renderers_correction_misses_the_ground(egl: int) -> None:
    error_m, _ = ground_error(egl, (0.2, 0.15, 0.7), "egl", SAMPLE_OFFSET_PIX["tiny"])
    assert np.median(error_m) > 0.1


def test_depth_is_infinite_where_nothing_is_hit(tiny: int) -> None:
    add_ground(tiny)
    depth_m, bodies = render(tiny, pose((0.3, 0.0, 0.0), (-60.0, 0.0, 8.3)))
    assert (bodies < 0).any()
    assert np.isinf(depth_m[bodies < 0]).all()
    assert np.isfinite(depth_m[bodies >= 0]).all()


def test_depth_from_buffer_inverts_the_projection_matrix() -> None:
    gl = np.reshape(
        projection_matrix(PIX_FROM_CAMERA, WIDTH, HEIGHT, NEAR_M, FAR_M, UNCORRECTED), (4, 4)
    ).T
    depth_m = np.array([[NEAR_M, 1.0, 7.5, 60.0, 119.0]])
    clip = gl @ np.stack([0 * depth_m[0], 0 * depth_m[0], -depth_m[0], 1 + 0 * depth_m[0]])
    buffer = (clip[2] / clip[3] + 1) / 2
    assert buffer[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(depth_from_buffer(buffer[None], NEAR_M, FAR_M), depth_m, rtol=1e-9)


def test_a_sphere_is_in_view_if_any_of_its_points_is() -> None:
    generator = np.random.default_rng(0)
    camera_from_world = g.inverse(pose((0.4, -0.2, 2.0), (5.0, -3.0, 8.0)) @ BODY_FROM_CAMERA)
    planes = frustum_planes(PIX_FROM_CAMERA, WIDTH, HEIGHT)
    middle_m = generator.uniform(-150, 150, (4000, 3))
    reach_m = generator.uniform(0.5, 20, 4000)
    seen = in_view(planes, camera_from_world.numpy(), middle_m, reach_m)
    towards = generator.normal(size=(4000, 300, 3))
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    points_m = torch.from_numpy(middle_m[:, None] + reach_m[:, None, None] * towards)
    points_camera = g.transform(camera_from_world, points_m.reshape(-1, 3))
    pix, depth_m = g.project(points_m.reshape(-1, 3), camera_from_world, PIX_FROM_CAMERA)
    shown = g.in_image(pix, depth_m, WIDTH, HEIGHT) & (points_camera[:, 2] < FAR_M)
    shown = shown.reshape(4000, 300).any(dim=1).numpy()
    assert seen[shown].all()
    # Spheres near an edge of the frustum are kept though nothing of them is seen: not many.
    assert 0.05 < shown.mean() <= seen.mean() < 1.4 * shown.mean()


# -------------------------------------------------------------------------------------- a box


def box_scene(
    client: int, attitude_rad: tuple[float, float, float]
) -> tuple[Float[Tensor, "4 4"], Float[Tensor, "4 4"], Float[Tensor, "4 4"]]:
    """world_from_body, occ_from_box and camera_from_occ of a turned box before the camera."""
    world_from_body = pose(attitude_rad, (20.0, -7.0, 9.0))
    before_camera = torch.tensor([[0.4, -0.3, 12.0]], dtype=torch.float64)
    middle_m = g.transform(world_from_body @ BODY_FROM_CAMERA, before_camera)[0]
    world_from_box = g.rigid(pose((0.4, -0.2, 1.1), (0.0, 0.0, 0.0))[:3, :3], middle_m)
    add_box(client, BOX_SIZE_M, world_from_box)
    occ_from_box = g.inverse(g.world_from_occ(world_from_body)) @ world_from_box
    return world_from_body, occ_from_box, g.camera_from_occ(world_from_body, BODY_FROM_CAMERA)


def distance_to_outline(
    occ_from_box: Float[Tensor, "4 4"], camera_from_occ: Float[Tensor, "4 4"]
) -> Float[np.ndarray, "h w"]:
    """Pixels from every pixel's centre to the outline of the projected corners, inside positive."""
    signs = torch.cartesian_prod(*[torch.tensor([-0.5, 0.5], dtype=torch.float64)] * 3)
    corners_box = signs * torch.tensor(BOX_SIZE_M, dtype=torch.float64)
    corners_occ = g.transform(occ_from_box, corners_box)
    corners_pix, _ = g.project(corners_occ, camera_from_occ, PIX_FROM_CAMERA)
    outline = cv2.convexHull(corners_pix.numpy().astype(np.float32))
    centres = g.pixel_centres(WIDTH, HEIGHT).reshape(-1, 2).tolist()
    distances = [cv2.pointPolygonTest(outline, centre, measureDist=True) for centre in centres]
    return np.reshape(distances, (HEIGHT, WIDTH))


def misjudged_pix(
    client: int,
    attitude_rad: tuple[float, float, float],
    sample_offset_pix: tuple[float, float] | None = None,
) -> float:
    """How far from the projected outline the worst pixel lies that is on its wrong side."""
    world_from_body, occ_from_box, camera_from_occ = box_scene(client, attitude_rad)
    _, bodies = render(client, world_from_body, sample_offset_pix=sample_offset_pix)
    distance = distance_to_outline(occ_from_box, camera_from_occ)
    assert (distance > 0).sum() > 300
    wrong = (bodies >= 0) != (distance > 0)
    return float(np.abs(distance[wrong]).max(initial=0.0))


@pytest.mark.parametrize("attitude_rad", ATTITUDES)
def test_a_boxs_silhouette_is_the_outline_of_its_projected_corners(
    tiny: int, attitude_rad: tuple[float, float, float]
) -> None:
    assert misjudged_pix(tiny, attitude_rad) < 0.05


def test_without_the_correction_the_silhouette_is_off(tiny: int) -> None:
    assert misjudged_pix(tiny, ATTITUDES[1], UNCORRECTED) > 0.3


@pytest.mark.parametrize("attitude_rad", ATTITUDES)
def test_the_faces_of_a_box_have_their_depth(
    tiny: int, attitude_rad: tuple[float, float, float]
) -> None:
    world_from_body, occ_from_box, camera_from_occ = box_scene(tiny, attitude_rad)
    rendered_m, _ = render(tiny, world_from_body)
    normals_box = torch.cat([torch.eye(3), -torch.eye(3)]).to(torch.float64)
    faces_box = normals_box * torch.tensor(BOX_SIZE_M, dtype=torch.float64) / 2
    camera_from_box = camera_from_occ @ occ_from_box
    faces_camera = g.transform(camera_from_box, faces_box)
    normals_camera = normals_box @ camera_from_box[:3, :3].T
    facing = -torch.cosine_similarity(faces_camera, normals_camera)
    seen = facing > 0.2  # A face seen from its edge is narrower than a pixel.
    faces_occ = g.transform(occ_from_box, faces_box[seen])
    pix, depth_m = g.project(faces_occ, camera_from_occ, PIX_FROM_CAMERA)
    assert len(pix) >= 2
    for (u, v), expected_m in zip(pix.tolist(), depth_m.tolist()):
        assert depth_at(rendered_m, u, v) == pytest.approx(expected_m, abs=0.01)


def depth_at(depth_m: Float[np.ndarray, "h w"], u: float, v: float) -> float:
    """Depth at a location between pixel centres; 1 / depth is linear over the image of a plane."""
    column, row = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
    right, down = u - 0.5 - column, v - 0.5 - row
    inverse_depth = 1 / depth_m[row : row + 2, column : column + 2]
    return float(1 / (np.array([1 - down, down]) @ inverse_depth @ np.array([1 - right, right])))
