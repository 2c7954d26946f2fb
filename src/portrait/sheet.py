"""Shots put together into one picture, with a title over each."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..atomic import replacing

GAP_PIX, TITLE_PIX, DPI = 8, 32, 100
INK = "#181c24"


def write_sheet(
    rows: Sequence[Sequence[tuple[str, UInt8[np.ndarray, "h w 3"]]]],
    path: Path,
    cell_width_pix: int,
    max_bytes: int,
) -> None:
    """Write a JPEG of rows of titled pictures, of as good a quality as ``max_bytes`` allow.

    All pictures are scaled to one width; their shapes are taken to be the same. Raises `UserError`
    for a path that cannot be written.
    """
    sheet = Image.fromarray(_composed(rows, cell_width_pix))
    encoded = next(
        (data for quality in range(92, 39, -4) if len(data := _jpeg(sheet, quality)) <= max_bytes),
        _jpeg(sheet, 40),
    )
    with replacing(path) as temporary:
        temporary.write_bytes(encoded)


def _composed(
    rows: Sequence[Sequence[tuple[str, UInt8[np.ndarray, "h w 3"]]]], cell_width_pix: int
) -> UInt8[np.ndarray, "H W 3"]:
    height_pix, width_pix = rows[0][0][1].shape[:2]
    cell_pix = (cell_width_pix, round(cell_width_pix * height_pix / width_pix))
    row_pix = cell_pix[1] + TITLE_PIX
    width = GAP_PIX + max(map(len, rows)) * (cell_pix[0] + GAP_PIX)
    height = len(rows) * row_pix + GAP_PIX
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    for n, row in enumerate(rows):
        for k, (title, picture) in enumerate(row):
            left, top = GAP_PIX + k * (cell_pix[0] + GAP_PIX), n * row_pix
            middle = 1 - (top + 0.55 * TITLE_PIX) / height
            figure.text((left + 2) / width, middle, title, size=13, va="center", color=INK)
            scaled = Image.fromarray(picture).resize(cell_pix, Image.Resampling.LANCZOS)
            # figimage counts from the bottom, and is the one way to place pixels unresampled.
            bottom = height - top - row_pix
            figure.figimage(np.asarray(scaled)[::-1], left, bottom, origin="lower")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:height, :width, :3].copy()


def _jpeg(sheet: Image.Image, quality: int) -> bytes:
    buffer = io.BytesIO()
    sheet.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
    return buffer.getvalue()
