"""Figures as small files."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..atomic import replacing


def image_of(figure: Figure) -> Image.Image:
    """Draws a figure in RGB."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def write_figure(figure: Figure, path: str | Path) -> None:
    """Writes a PNG of 256 colors, which is a third of the bytes that a plot has with all colors.

    Raises `UserError` for a path that cannot be written.
    """
    with replacing(path) as temporary:
        image_of(figure).quantize(256).save(temporary, format="png", optimize=True)
