"""The paper's qualitative figure: RGB, ground truth and predictions, in 3-D and from above."""

from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageOps

from ..errors import UserError
from .canvas import MUTED, Canvas, Pixels, beside, write_picture
from .scene import VoxelScene
from .top import render_top

ROW_PIX, GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 440, 18, 46, 112, 104
# Of the image, a picture in 3-D and one from above.
WIDTHS_PIX = (528, 550, 409)
BEHIND = "Seen from behind and above the UAV"
ABOVE = ", and from above with its heading up. Free space shows from above only;"
HIDDEN = " space without a label is hidden in ground truth and prediction alike."


def pick_frames(tilt_rad: Float[np.ndarray, "n"], count: int) -> list[int]:
    """Picks frames to show, by rule: the most tilted one, the others evenly spaced.

    ``tilt_rad`` is a frame's |roll| + |pitch|. The evenly spaced frames are the middles of equal
    parts of the sequence; where the most tilted frame is one of them, the next most tilted one is
    added. Ascending and distinct; at most n.
    """
    n_frames = len(tilt_rad)
    if count >= n_frames:
        return list(range(n_frames))
    # Middles of count - 1 equal parts; the most tilted frame is the last one.
    even = [(2 * part + 1) * n_frames // (2 * (count - 1)) for part in range(count - 1)]
    most_tilted_first = np.argsort(-np.asarray(tilt_rad), kind="stable").tolist()
    return sorted([*even, next(frame for frame in most_tilted_first if frame not in even)])


def qualitative_sheet(
    scenes: Sequence[VoxelScene], path: str | Path, heading: str, tops: bool = True
) -> None:
    """Writes the sheet as a PNG or, by its suffix, a JPEG, with one row a scene.

    Columns: RGB, ground truth and each prediction in 3-D and, with ``tops``, all of them again from
    above. A prediction is hidden where the truth is unknown, so that all show the same space.
    Raises `UserError` for no scenes, scenes whose predictions have other names, and a path that
    cannot be written.
    """
    if not scenes:
        raise UserError(f"{path}: no frames to draw; the split is empty")
    names = list(scenes[0].volumes)
    # One header names the columns of all rows.
    if any(list(scene.volumes) != names for scene in scenes):
        raise UserError(f"{path}: its rows show predictions of different models; draw two sheets")

    columns = ["RGB", *names, *(f"{name}, top" for name in names if tops)]
    rows = [_pictures(scene, tops) for scene in scenes]
    widths = [picture.shape[1] for picture in rows[0]]
    # Where each column begins, and at last where the page ends.
    *left, width = accumulate((w + GAP_PIX for w in widths), initial=GAP_PIX)
    page = Canvas(width, HEADER_PIX + len(rows) * (ROW_PIX + TITLE_PIX) + FOOTER_PIX)
    page.text(GAP_PIX, 30, heading, size=21, weight="bold")
    for name, u, w in zip(columns, left, widths):
        page.text(u + w / 2, 88, name, size=18, ha="center")
    for n, (row, scene) in enumerate(zip(rows, scenes)):
        top = HEADER_PIX + n * (ROW_PIX + TITLE_PIX)
        page.text(GAP_PIX, top + TITLE_PIX / 2, scene.title, size=15, color=MUTED)
        page.picture(beside(row, GAP_PIX), GAP_PIX, top + TITLE_PIX)
    page.legend(page.height_pix - 66)
    caption = f"{BEHIND}{ABOVE if tops else ';'}{HIDDEN}"
    page.text(width / 2, page.height_pix - 22, caption, size=14, ha="center", color=MUTED)
    write_picture(page.drawn(), path)


def _pictures(scene: VoxelScene, tops: bool) -> list[Pixels]:
    """The pictures of a row, all of one height."""
    image_size, size, top_size = ((width_pix, ROW_PIX) for width_pix in WIDTHS_PIX)
    # The image is as large as its cell allows, at the top of it.
    image = Image.fromarray(scene.image)
    image = ImageOps.pad(image, image_size, color="white", centering=(0.5, 0.0))
    pictures = [np.asarray(image), *scene.drawn(size).values()]
    if tops:
        pictures += [render_top(v, scene.grid, top_size) for v in scene.known().values()]
    return pictures
