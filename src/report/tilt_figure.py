"""Why attitude matters: one tilted frame, with its camera where it is, and where a level UAV's is.

The paper's dynamic extrinsics (Eq. 5, App. B on the kinematic-geometric coupling), as a picture.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from .canvas import MUTED, Canvas, resized, write_picture
from .labels_in_image import labels_in_image
from .qualitative import add_legend
from .scene import VoxelScene
from .view import Frustum
from .voxels import ground_level, render_voxels, view_of

CELL_PIX = (620, 400)
GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 18, 40, 60, 60

# Depth of the drawn frustum, as a share of the grid's length.
FRUSTUM_SHARE = 0.3

Picture = UInt8[np.ndarray, "h w 3"]


def draw_tilt(scene: VoxelScene, level: Frustum, path: str | Path) -> None:
    """Writes a picture of the scene's frame, a PNG or, by its suffix, a JPEG.

    It shows the image, a row for the frame's own camera, and a row for ``level``, the camera of a
    UAV without roll and pitch.

    A row has the labels in the occ frame with the camera's frustum, and the image under the labels
    as that camera would see them: only with the true one do colors lie on their objects. Raises
    `UserError` for a path that cannot be written.
    """
    rows = {
        "Measured attitude: the frustum tilts with the UAV": _pictures(scene, scene.frustum),
        "A level UAV instead: by so much the labels miss their objects": _pictures(scene, level),
    }
    page = _page(_as_high(scene.image), rows, scene.title)

    write_picture(page.drawn(), path)


def _pictures(scene: VoxelScene, camera: Frustum) -> list[Picture]:
    view = view_of([scene.truth], scene.grid, CELL_PIX)
    floor_m = ground_level(scene.truth, scene.grid)
    # The labels are the same in both rows; only the camera differs (Eq. 5).
    in_space = render_voxels(
        scene.truth, scene.grid, CELL_PIX, view, camera, floor_m, FRUSTUM_SHARE
    )
    in_image = labels_in_image(scene.image, scene.truth, scene.grid, camera)
    return [in_space, _as_high(in_image)]


def _as_high(image: Picture) -> Picture:
    """An image as high as a cell."""
    height, width = image.shape[:2]
    return resized(image, round(width * CELL_PIX[1] / height), CELL_PIX[1])


def _page(image: Picture, rows: Mapping[str, Sequence[Picture]], heading: str) -> Canvas:
    """The image stands before both rows, halfway up."""
    widths = [image.shape[1], *(picture.shape[1] for picture in next(iter(rows.values())))]
    row_pix = CELL_PIX[1] + TITLE_PIX
    height = HEADER_PIX + len(rows) * row_pix + FOOTER_PIX
    page = Canvas(sum(widths) + (len(widths) + 1) * GAP_PIX, height)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=20, weight="bold")
    page.picture(image, GAP_PIX, HEADER_PIX + (len(rows) * row_pix - image.shape[0]) // 2)

    for n, (title, pictures) in enumerate(rows.items()):
        top, left = HEADER_PIX + n * row_pix, image.shape[1] + 2 * GAP_PIX
        page.text(left, top + TITLE_PIX / 2, title, size=16, color=MUTED)
        for picture in pictures:
            page.picture(picture, left, top + TITLE_PIX)
            left += picture.shape[1] + GAP_PIX
    add_legend(page.figure, FOOTER_PIX / 2 / height, skip=("free",))

    return page
