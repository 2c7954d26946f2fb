"""One picture of a data set: a frame of every town under every weather that it was flown in."""

import io
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..atomic import replacing
from ..data.clip import Clip
from ..data.statistics import Statistics
from .statistics_figure import INK, readable

CELL_WIDTH_PIX, GAP_PIX, LABEL_PIX, HEADER_PIX = 288, 8, 34, 44
JPEG_QUALITY, DPI = 88, 100


def draw_contact_sheet(root: Path, statistics: Statistics, path: str | Path) -> None:
    """Write a JPEG: a row a town, a column a weather, the middle frame of the first such clip.

    A cell is blank where a town was never flown in a weather. Raises `UserError` for an image that
    cannot be read and a path that cannot be written.
    """
    clips = statistics.clips.drop_duplicates(["town", "weather"])
    towns, weathers = (list(clips[key].unique()) for key in ("town", "weather"))
    pictures = {
        (towns.index(row.town), weathers.index(row.weather)): _picture(Clip(root / row.clip))
        for row in clips.itertuples()
    }
    cell_height_pix = max(picture.shape[0] for picture in pictures.values())
    width = GAP_PIX + LABEL_PIX + len(weathers) * (CELL_WIDTH_PIX + GAP_PIX)
    height = HEADER_PIX + len(towns) * (cell_height_pix + GAP_PIX)
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    lefts = [LABEL_PIX + GAP_PIX + n * (CELL_WIDTH_PIX + GAP_PIX) for n in range(len(weathers))]
    tops = [HEADER_PIX + n * (cell_height_pix + GAP_PIX) for n in range(len(towns))]
    style = {"size": 17, "ha": "center", "va": "center", "color": INK}
    for left, weather in zip(lefts, weathers):
        u, v = left + CELL_WIDTH_PIX / 2, HEADER_PIX / 2
        figure.text(u / width, 1 - v / height, readable(weather), **style)
    for top, town in zip(tops, towns):
        u, v = LABEL_PIX / 2, top + cell_height_pix / 2
        figure.text(u / width, 1 - v / height, readable(town), rotation=90, **style)
    for (row, column), picture in pictures.items():
        # figimage counts from the bottom, and is the one way to place pixels unresampled.
        bottom = height - tops[row] - picture.shape[0]
        figure.figimage(picture[::-1], lefts[column], bottom, origin="lower")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    _save(np.asarray(canvas.buffer_rgba())[..., :3], path)


def _picture(clip: Clip) -> np.ndarray:
    """The frame in the middle of a clip, as wide as a cell."""
    image = Image.fromarray(clip.image(len(clip) // 2))
    height_pix = round(image.height * CELL_WIDTH_PIX / image.width)
    return np.asarray(image.resize((CELL_WIDTH_PIX, height_pix), Image.Resampling.LANCZOS))


def _save(sheet: np.ndarray, path: str | Path) -> None:
    buffer = io.BytesIO()
    Image.fromarray(sheet).save(buffer, "JPEG", quality=JPEG_QUALITY)
    with replacing(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
