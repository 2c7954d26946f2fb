"""Shots put together into one picture, with a title over each."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ..report.canvas import Canvas, resized, write_picture

GAP_PIX, TITLE_PIX = 8, 32


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
    height_pix, width_pix = rows[0][0][1].shape[:2]
    cell_pix = (cell_width_pix, round(cell_width_pix * height_pix / width_pix))
    row_pix = cell_pix[1] + TITLE_PIX
    width = GAP_PIX + max(map(len, rows)) * (cell_pix[0] + GAP_PIX)
    page = Canvas(width, len(rows) * row_pix + GAP_PIX)

    for n, row in enumerate(rows):
        for k, (title, picture) in enumerate(row):
            left, top = GAP_PIX + k * (cell_pix[0] + GAP_PIX), n * row_pix
            page.text(left + 2, top + 0.55 * TITLE_PIX, title, size=13)
            page.picture(resized(picture, *cell_pix), left, top + TITLE_PIX)
    write_picture(page.drawn(), path, max_bytes)
