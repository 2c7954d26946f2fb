"""A white page on which text and pictures are placed to the pixel, and its files."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..atomic import replacing

DPI = 100
INK, MUTED = "#181c24", "#5a606a"

# How heavy a figure may be, by the suffix of its path.
MAX_BYTES = {".png": 1_500_000, ".jpg": 500_000}
# Qualities of a JPEG, the best first.
QUALITIES = range(92, 39, -4)


class Canvas:
    """A page; places are in pixels from its upper left corner."""

    def __init__(self, width_pix: int, height_pix: int) -> None:
        self.width_pix, self.height_pix = width_pix, height_pix
        size_inches = (width_pix / DPI, height_pix / DPI)
        self.figure = Figure(figsize=size_inches, dpi=DPI, facecolor="white")
        self._pictures: list[tuple[UInt8[np.ndarray, "h w 3"], tuple[int, int]]] = []

    def text(self, u: float, v: float, content: str, **style) -> None:
        """Text whose middle is at height ``v``; ``style`` is matplotlib's."""
        style = {"va": "center", "color": INK, **style}
        self.figure.text(u / self.width_pix, 1 - v / self.height_pix, content, **style)

    def picture(self, pixels: UInt8[np.ndarray, "h w 3"], u: int, v: int) -> None:
        """A picture, pixel by pixel, with its upper left corner at a place."""
        self._pictures.append((pixels, (u, v)))

    def drawn(self) -> Image.Image:
        """The page as it is now."""
        canvas = FigureCanvasAgg(self.figure)
        canvas.draw()
        page = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        # Inches are rounded to pixels upwards now and then.
        page = page.crop((0, 0, self.width_pix, self.height_pix))

        # Pasted, not drawn: matplotlib loses the last column of pixels where inches are rounded.
        for pixels, corner in self._pictures:
            page.paste(Image.fromarray(pixels), corner)
        return page


def resized(
    picture: UInt8[np.ndarray, "h w 3"], width_pix: int, height_pix: int
) -> UInt8[np.ndarray, "H W 3"]:
    """A picture at another size, sharp."""
    image = Image.fromarray(picture).resize((width_pix, height_pix), Image.Resampling.LANCZOS)
    return np.asarray(image)


def write_jpeg(image: Image.Image, path: str | Path, quality: int) -> None:
    """Writes a JPEG of one quality. Raises `UserError` for a path that cannot be written."""
    with replacing(path) as temporary:
        image.save(temporary, "JPEG", quality=quality)


def write_picture(image: Image.Image, path: str | Path, max_bytes: int | None = None) -> None:
    """Writes a JPEG or a PNG, by the suffix of the path, of at most some bytes.

    A JPEG that is too heavy gets less quality, down to 40; a PNG gets smaller. Raises `UserError`
    for a path that cannot be written.
    """
    suffix = Path(path).suffix
    max_bytes = max_bytes or MAX_BYTES[suffix]
    if suffix == ".jpg":
        encoded = _small_jpeg(image, max_bytes)
    else:
        encoded = within_bytes([image], _png, max_bytes)

    with replacing(path) as temporary:
        temporary.write_bytes(encoded)


def within_bytes(
    pictures: list[Image.Image], encode: Callable[[list[Image.Image]], bytes], max_bytes: int
) -> bytes:
    """Encodes pictures of one size, and smaller ones where the whole ones are too heavy."""
    encoded = encode(pictures)
    while len(encoded) > max_bytes:
        share = max(0.5, min(0.95, (max_bytes / len(encoded)) ** 0.5))
        size_pix = (int(pictures[0].width * share), int(pictures[0].height * share))
        pictures = [picture.resize(size_pix, Image.Resampling.LANCZOS) for picture in pictures]
        encoded = encode(pictures)

    return encoded


def _png(pictures: list[Image.Image]) -> bytes:
    buffer = io.BytesIO()
    pictures[0].save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _small_jpeg(image: Image.Image, max_bytes: int) -> bytes:
    for quality in QUALITIES:
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
        if buffer.tell() <= max_bytes:
            break

    return buffer.getvalue()
