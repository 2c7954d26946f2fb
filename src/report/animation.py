"""One flight as a looping picture: what the camera sees, and the labels of the space ahead."""

import io
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from PIL import Image

from ..atomic import replacing
from ..data.clip import Clip
from ..data.statistics import Statistics
from .canvas import within_bytes
from .view import Frustum
from .voxels import render_voxels, view_of

SECONDS, FRAME_HZ = 4.0, 5.0
HEIGHT_PIX, VOXEL_ASPECT, GAP_PIX = 288, 1.25, 8
MAX_BYTES = 6_000_000


def draw_flight(root: Path, statistics: Statistics, path: str | Path) -> None:
    """Write a GIF of at most 6 MB: image left, labels in 3-D right, in real time.

    Shows the `liveliest` clip, 4 s around its middle. Raises `UserError` for a clip that cannot be
    read and a path that cannot be written.
    """
    clip = Clip(root / liveliest(statistics.clips, statistics.frames))
    stride = max(1, round(clip.meta.capture_hz / FRAME_HZ))
    count = round(SECONDS * clip.meta.capture_hz / stride)
    first = (len(clip) - count * stride) // 2
    pictures = _pictures(clip, range(first, first + count * stride, stride))
    duration_ms = round(1000 * stride / clip.meta.capture_hz)
    encoded = within_bytes(pictures, partial(_gif, duration_ms=duration_ms), MAX_BYTES)

    with replacing(path) as temporary:
        temporary.write_bytes(encoded)


def liveliest(clips: pd.DataFrame, frames: pd.DataFrame) -> str:
    """The clip in whose image most actors are visible, among those of the first weather."""
    first = frames[frames["weather"] == clips["weather"].iloc[0]].set_index("clip")
    visible = first.filter(like="visible/").sum(axis=1)
    return visible.groupby(level=0, sort=False).mean().idxmax()


def _pictures(clip: Clip, frames: range) -> list[Image.Image]:
    """Image and labels of every frame, side by side, the labels from one steady point of view."""
    grid, size_pix = clip.meta.grid, (round(HEIGHT_PIX * VOXEL_ASPECT), HEIGHT_PIX)
    labels = {n: clip.semantics(n) for n in frames}
    view = view_of(list(labels.values()), grid, size_pix)

    return [
        _side_by_side(
            clip.image(n), render_voxels(labels[n], grid, size_pix, view, Frustum.of(clip, n))
        )
        for n in frames
    ]


def _side_by_side(
    image: UInt8[np.ndarray, "h w 3"], voxels: UInt8[np.ndarray, "H W 3"]
) -> Image.Image:
    left, right = Image.fromarray(image), Image.fromarray(voxels)
    width_pix = round(left.width * HEIGHT_PIX / left.height)
    sheet = Image.new("RGB", (width_pix + GAP_PIX + right.width, HEIGHT_PIX), (255, 255, 255))
    sheet.paste(left.resize((width_pix, HEIGHT_PIX), Image.Resampling.LANCZOS), (0, 0))
    sheet.paste(right, (width_pix + GAP_PIX, 0))
    return sheet


def _gif(pictures: list[Image.Image], duration_ms: int) -> bytes:
    # Median cut would give the few voxels of a rare class their neighbours' color.
    first, *others = (p.quantize(256, Image.Quantize.FASTOCTREE) for p in pictures)
    settings = {"duration": duration_ms, "loop": 0, "optimize": False}

    buffer = io.BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, **settings)
    return buffer.getvalue()
