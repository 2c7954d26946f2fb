"""Why attitude matters: one tilted frame, with its camera where it is, and where a level UAV's is.

The paper's dynamic extrinsics (Eq. 5, App. A.1 on the kinematic-geometric coupling), as a picture.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch

from src.data.clip import Clip
from src.geometry import camera_from_occ
from src.report.canvas import MUTED, Canvas, Pixels, beside, resized, write_picture
from src.report.scene import VoxelScene
from src.report.view import Frustum
from src.report.voxels import ground_level, labels_in_image, render_voxels, view_of

CELL_PIX = (620, 400)
GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 18, 40, 60, 60

# Depth of the drawn frustum, as a share of the grid's length.
FRUSTUM_SHARE = 0.3


def draw_tilt(scene: VoxelScene, level: Frustum, path: str | Path) -> None:
    """Writes a picture of the scene's frame, a PNG or, by its suffix, a JPEG.

    It shows the image, a row for the frame's own camera, and a row for ``level``, the camera of a
    UAV without roll and pitch.

    A row has the labels in the occ frame with the camera's frustum, and the image under the labels
    as that camera would see them: only with the true one do colors lie on their objects. Raises
    `UserError` for a path that cannot be written.
    """
    rows = {
        "Measured attitude: the frustum tilts with the UAV": _row(scene, scene.frustum),
        "A level UAV instead: by so much the labels miss their objects": _row(scene, level),
    }
    write_picture(_page(_as_high(scene.image), rows, scene.title).drawn(), path)


def level_camera(camera: Frustum, clip: Clip) -> Frustum:
    """Returns a camera as it would be on a level UAV, by its mount in the clip."""
    mount = clip.meta.body_from_camera.to(camera.camera_from_occ)
    return replace(camera, camera_from_occ=camera_from_occ(torch.eye(4).to(mount), mount))


def _row(scene: VoxelScene, camera: Frustum) -> Pixels:
    view = view_of([scene.truth], scene.grid, CELL_PIX)
    floor_m = ground_level(scene.truth, scene.grid)
    # The labels are the same in both rows; only the camera differs (Eq. 5).
    in_space = render_voxels(
        scene.truth, scene.grid, CELL_PIX, view, camera, floor_m, FRUSTUM_SHARE
    )
    in_image = labels_in_image(scene.image, scene.truth, scene.grid, camera)
    return beside([in_space, _as_high(in_image)], GAP_PIX)


def _as_high(image: Pixels) -> Pixels:
    """An image as high as a cell."""
    return resized(image, height_pix=CELL_PIX[1])


def _page(image: Pixels, rows: Mapping[str, Pixels], heading: str) -> Canvas:
    """The image stands before both rows, halfway up."""
    row_pix, left = CELL_PIX[1] + TITLE_PIX, image.shape[1] + 2 * GAP_PIX
    width = left + next(iter(rows.values())).shape[1] + GAP_PIX
    page = Canvas(width, HEADER_PIX + len(rows) * row_pix + FOOTER_PIX)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=20, weight="bold")
    page.picture(image, GAP_PIX, HEADER_PIX + (len(rows) * row_pix - image.shape[0]) // 2)

    for n, (title, row) in enumerate(rows.items()):
        top = HEADER_PIX + n * row_pix
        page.text(left, top + TITLE_PIX / 2, title, size=16, color=MUTED)
        page.picture(row, left, top + TITLE_PIX)
    page.legend(page.height_pix - FOOTER_PIX / 2, skip=("free",))

    return page
