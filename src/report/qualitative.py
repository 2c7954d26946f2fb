"""The paper's qualitative figure: RGB, ground truth and prediction, in 3-D and from above."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from ..atomic import replacing
from ..errors import UserError
from ..geometry import VoxelGrid
from ..ontology import CLASSES, COLORS, UNKNOWN
from .canvas import MUTED, Canvas
from .top import render_top
from .view import Frustum
from .voxels import ground_level, render_voxels, view_of

ROW_PIX, GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 440, 18, 46, 112, 104
COLUMNS = ("RGB", "Ground truth", "Prediction", "Ground truth, top", "Prediction, top")
IMAGE_ASPECT, VOXEL_ASPECT, TOP_ASPECT = 1.2, 1.25, 0.93
MAX_BYTES = 1_500_000
CAPTION = (
    "Seen from behind and above the UAV, and from above with its heading up. Free space shows from "
    "above only; space without a label is hidden in ground truth and prediction alike."
)


@dataclass(frozen=True)
class Example:
    """One row of the sheet: what the camera saw, the labels, and what the model made of it.

    ``title`` says which frame it is, such as ``"downtown-03 frame 41 · roll +12° pitch −5°"``.
    ``frustum``, if given, is drawn into the 3-D pictures.
    """

    image: UInt8[np.ndarray, "h w 3"]
    truth: UInt8[np.ndarray, "X Y Z"]
    prediction: UInt8[np.ndarray, "X Y Z"]
    title: str
    frustum: Frustum | None = None


def pick_frames(tilt_rad: Float[np.ndarray, "n"], count: int) -> list[int]:
    """Which of n frames to show, by rule: the most tilted one, the others evenly spaced.

    ``tilt_rad`` is a frame's |roll| + |pitch|. The evenly spaced frames are the middles of equal
    parts of the sequence; where the most tilted frame is one of them, the next most tilted one is
    added. Ascending and distinct; at most n.
    """
    n_frames = len(tilt_rad)
    if count >= n_frames:
        return list(range(n_frames))
    even = [(2 * part + 1) * n_frames // (2 * (count - 1)) for part in range(count - 1)]
    most_tilted_first = np.argsort(-np.asarray(tilt_rad), kind="stable").tolist()
    return sorted([*even, next(frame for frame in most_tilted_first if frame not in even)])


def qualitative_sheet(
    examples: Sequence[Example], grid: VoxelGrid, path: str | Path, heading: str
) -> None:
    """Write the sheet as a PNG of at most 1.5 MB, one row an example.

    Columns: RGB, ground truth and prediction in 3-D, ground truth and prediction from above. The
    prediction is hidden where the truth is unknown, so that both show the same space. Raises
    `UserError` for no examples, labels that do not have the grid's shape, and a path that cannot be
    written.
    """
    if not examples:
        raise UserError(f"{path}: no frames to draw; the split is empty")
    sheet = _compose([_pictures(example, grid) for example in examples], examples, heading)
    with replacing(path) as temporary:
        temporary.write_bytes(_encode(sheet))


def _pictures(example: Example, grid: VoxelGrid) -> list[UInt8[np.ndarray, "h w 3"]]:
    """The pictures of a row, all of one height."""
    known = np.where(example.truth == UNKNOWN, np.uint8(UNKNOWN), example.prediction)
    size, top_size = ((round(ROW_PIX * a), ROW_PIX) for a in (VOXEL_ASPECT, TOP_ASPECT))
    view = view_of([example.truth, known], grid, size)
    floor_m = ground_level(example.truth, grid)
    return [
        _fit(example.image),
        *(
            render_voxels(labels, grid, size, view, example.frustum, floor_m)
            for labels in (example.truth, known)
        ),
        *(render_top(labels, grid, top_size) for labels in (example.truth, known)),
    ]


def _fit(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """The image as large as its cell allows, at the top of it, on white."""
    height, width = image.shape[:2]
    cell_pix = (round(ROW_PIX * IMAGE_ASPECT), ROW_PIX)
    scale = min(cell_pix[0] / width, cell_pix[1] / height)
    scaled = Image.fromarray(image).resize(
        (round(width * scale), round(height * scale)), Image.Resampling.BICUBIC
    )
    cell = Image.new("RGB", cell_pix, (255, 255, 255))
    cell.paste(scaled, ((cell_pix[0] - scaled.width) // 2, 0))
    return np.asarray(cell)


def _compose(
    rows: list[list[UInt8[np.ndarray, "h w 3"]]], examples: Sequence[Example], heading: str
) -> Image.Image:
    widths = [max(row[n].shape[1] for row in rows) for n in range(len(COLUMNS))]
    left = [GAP_PIX + sum(widths[:n]) + n * GAP_PIX for n in range(len(COLUMNS))]
    width = left[-1] + widths[-1] + GAP_PIX
    height = HEADER_PIX + len(rows) * (ROW_PIX + TITLE_PIX) + FOOTER_PIX
    page = Canvas(width, height)
    page.text(GAP_PIX, 30, heading, size=21, weight="bold")
    for n, name in enumerate(COLUMNS):
        page.text(left[n] + widths[n] / 2, 88, name, size=18, ha="center")
    for n, (row, example) in enumerate(zip(rows, examples)):
        top = HEADER_PIX + n * (ROW_PIX + TITLE_PIX)
        page.text(GAP_PIX, top + TITLE_PIX / 2, example.title, size=15, color=MUTED)
        for picture, u in zip(row, left):
            page.picture(picture, u, top + TITLE_PIX)
    add_legend(page.figure, 66 / height)
    page.text(width / 2, height - 22, CAPTION, size=14, ha="center", color=MUTED)
    return page.drawn()


def add_legend(figure: Figure, middle: float, skip: Sequence[str] = ()) -> None:
    """Name the classes' colours in one line, ``middle`` of the figure's height above its foot."""
    patches = [
        Patch(
            facecolor=np.array(COLORS[name]) / 255,
            edgecolor="#9aa0a8",
            label=name.upper() if name == "vru" else name.replace("_", " "),
        )
        for name in CLASSES
        if name not in skip
    ]
    figure.legend(
        handles=patches,
        loc="center",
        bbox_to_anchor=(0.5, middle),
        ncols=len(patches),
        frameon=False,
        fontsize=16,
        handlelength=1.1,
        handleheight=1.0,
        columnspacing=1.6,
        handletextpad=0.5,
    )


def _encode(sheet: Image.Image) -> bytes:
    """PNG bytes, of a smaller sheet where the whole one is too heavy."""
    while True:
        buffer = io.BytesIO()
        sheet.save(buffer, format="png", optimize=True)
        if buffer.tell() <= MAX_BYTES:
            return buffer.getvalue()
        share = max(0.5, min(0.95, (MAX_BYTES / buffer.tell()) ** 0.5))
        size = (int(sheet.width * share), int(sheet.height * share))
        sheet = sheet.resize(size, Image.Resampling.LANCZOS)
