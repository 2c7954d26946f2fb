"""One flight as a looping picture: what the camera sees, and the labels of the space ahead."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from PIL import Image

from ..atomic import replacing
from ..data.clip import Clip
from ..data.statistics import Statistics
from ..geometry import camera_from_occ
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
    with replacing(path) as temporary:
        temporary.write_bytes(_encode(pictures, duration_ms))


def liveliest(clips: pd.DataFrame, frames: pd.DataFrame) -> str:
    """The clip in whose image most actors are visible, among those of the first weather."""
    shown = frames[frames["weather"] == clips["weather"].iloc[0]].set_index("clip")
    visible = shown.filter(like="visible/").sum(axis=1)
    return visible.groupby(level=0, sort=False).mean().idxmax()


def _pictures(clip: Clip, frames: range) -> list[Image.Image]:
    """Image and labels of every frame, side by side, the labels from one steady point of view."""
    meta = clip.meta
    size_pix = (round(HEIGHT_PIX * VOXEL_ASPECT), HEIGHT_PIX)
    scenes = [clip.semantics(n) for n in frames]
    view = view_of(scenes, meta.grid, size_pix)
    pictures = []
    for n, labels in zip(frames, scenes):
        chain = camera_from_occ(clip.world_from_body[n], meta.body_from_camera)
        frustum = Frustum(chain, meta.pix_from_camera, (meta.width, meta.height))
        voxels = render_voxels(labels, meta.grid, size_pix, view, frustum)
        pictures.append(_side_by_side(clip.image(n), voxels))
    return pictures


def _side_by_side(
    image: UInt8[np.ndarray, "h w 3"], voxels: UInt8[np.ndarray, "H W 3"]
) -> Image.Image:
    left, right = Image.fromarray(image), Image.fromarray(voxels)
    width_pix = round(left.width * HEIGHT_PIX / left.height)
    sheet = Image.new("RGB", (width_pix + GAP_PIX + right.width, HEIGHT_PIX), (255, 255, 255))
    sheet.paste(left.resize((width_pix, HEIGHT_PIX), Image.Resampling.LANCZOS), (0, 0))
    sheet.paste(right, (width_pix + GAP_PIX, 0))
    return sheet


def _encode(pictures: list[Image.Image], duration_ms: int) -> bytes:
    """GIF bytes, of smaller pictures where the whole ones are too heavy."""
    while True:
        buffer = io.BytesIO()
        # Median cut would give the few voxels of a rare class their neighbours' color.
        first, *others = (p.quantize(256, Image.Quantize.FASTOCTREE) for p in pictures)
        settings = {"duration": duration_ms, "loop": 0, "optimize": False}
        first.save(buffer, "GIF", save_all=True, append_images=others, **settings)
        if buffer.tell() <= MAX_BYTES:
            return buffer.getvalue()
        share = max(0.5, min(0.95, (MAX_BYTES / buffer.tell()) ** 0.5))
        size_pix = (int(pictures[0].width * share), int(pictures[0].height * share))
        pictures = [picture.resize(size_pix, Image.Resampling.LANCZOS) for picture in pictures]
