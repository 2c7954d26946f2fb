"""The paper's qualitative figure: RGB, ground truth and predictions, in 3-D and from above."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageOps

from ..errors import UserError
from .canvas import GAP_PIX, MUTED, Pixels, titled_sheet, write_picture
from .scene import VoxelScene
from .top import render_top

ROW_PIX, HEADER_PIX, FOOTER_PIX = 440, 64, 104
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

    It has the image, ground truth and each prediction in 3-D and, with ``tops``, all of them again
    from above. A prediction is hidden where the truth is unknown, so that all show the same space.
    Raises `UserError` for no scenes, scenes whose predictions have other names, and a path that
    cannot be written.
    """
    if not scenes:
        raise UserError(f"{path}: no frames to draw; the split is empty")
    names = list(scenes[0].volumes)
    if any(list(scene.volumes) != names for scene in scenes):
        raise UserError(f"{path}: its rows show predictions of different models; draw two sheets")

    rows = [_row(scene, tops) for scene in scenes]
    page = titled_sheet(rows, None, HEADER_PIX, FOOTER_PIX, title_size=15)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=21, weight="bold")
    page.legend(page.height_pix - 66)
    caption = f"{BEHIND}{ABOVE if tops else ';'}{HIDDEN}"
    page.text(page.width_pix / 2, page.height_pix - 22, caption, size=14, ha="center", color=MUTED)
    write_picture(page.drawn(), path)


def _row(scene: VoxelScene, tops: bool) -> list[tuple[str, Pixels]]:
    """The titled pictures of a scene, all of one height."""
    image_size, size, top_size = ((width_pix, ROW_PIX) for width_pix in WIDTHS_PIX)
    # The image is as large as its cell allows, at the top of it.
    image = Image.fromarray(scene.image)
    image = ImageOps.pad(image, image_size, color="white", centering=(0.5, 0.0))
    pictures = [(scene.title, np.asarray(image)), *scene.drawn(size).items()]
    if tops:
        pictures += [
            (f"{name}, top", render_top(labels, scene.grid, top_size))
            for name, labels in scene.known().items()
        ]
    return pictures
