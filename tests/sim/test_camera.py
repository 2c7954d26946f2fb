"""The outline of what pybullet draws beside that of `geometry.project`, at rolled attitudes."""

import cv2
import numpy as np
import pytest
import torch

from src import geometry as g
from src.sim import camera
from src.sim.drawing import Drawing
from src.sim.mesh import mesh_of_solid
from src.sim.solid import Solid
from tests.sim.scenery import body_at
from tests.sim.weathers import WEATHERS

WIDTH, HEIGHT = 224, 128
PIX_FROM_CAMERA = g.pinhole(WIDTH, HEIGHT, np.deg2rad(90.0))
BODY_FROM_CAMERA = g.front_mount((0.12, 0.03, -0.05), pitch_rad=0.1)
BOX_SIZE_M = (3.0, 2.0, 4.0)


@pytest.fixture
def drawing():
    opened = Drawing("tiny")
    yield opened
    opened.close()


def drawn(drawing, world_from_body):
    """Marks the pixels on which something is drawn."""
    lens = PIX_FROM_CAMERA, WIDTH, HEIGHT, camera.NEAR_M, camera.FAR_M
    view = camera.view_matrix(g.inverse(world_from_body @ BODY_FROM_CAMERA))
    projection = camera.projection_matrix(*lens, camera.SAMPLE_OFFSET_PIX["tiny"])
    light = WEATHERS["clear"].light()
    *_, bullet_id = drawing.picture(WIDTH, HEIGHT, view, projection, light)
    return bullet_id >= 0


@pytest.mark.parametrize(
    "attitude_rad", [(0.0, 0.0, 0.0), (0.2, 0.15, 0.7), (-0.35, -0.1, 2.0), (0.3, 0.3, -1.2)]
)
def test_a_boxs_silhouette_is_the_outline_of_its_projected_corners(drawing, attitude_rad):
    world_from_body = body_at((20.0, -7.0, 9.0), *attitude_rad)
    before_camera = torch.tensor([[0.4, -0.3, 12.0]], dtype=torch.float64)
    middle_m = g.transform(world_from_body @ BODY_FROM_CAMERA, before_camera)[0]
    world_from_box = body_at(middle_m.tolist(), 0.4, -0.2, 1.1)
    mesh = mesh_of_solid(Solid("box", 0, BOX_SIZE_M, world_from_box.numpy(), "asphalt"))
    drawing.add(mesh, mesh.uvs_m, "asphalt")

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
    # Only pixels whose center lies on the outline itself may be on the wrong side of it.
    wrong = drawn(drawing, world_from_body) != (inside > 0)
    assert np.abs(inside[wrong]).max(initial=0.0) < 0.05
