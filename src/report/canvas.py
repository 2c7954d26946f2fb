"""A white page on which text and pictures are placed to the pixel, and its files."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from ..atomic import replacing
from ..ontology import CLASSES, COLORS
from .figure_file import image_of
from .picture import encoded

DPI = 100
INK, MUTED = "#181c24", "#5a606a"

# How heavy a figure may be, by the suffix of its path.
MAX_BYTES = {".png": 1_500_000, ".jpg": 500_000}
# Qualities of a JPEG, the best first.
QUALITIES = range(92, 39, -4)

Pixels = UInt8[np.ndarray, "h w 3"]


class Canvas:
    """A page; places are in pixels from its upper left corner."""

    def __init__(self, width_pix: int, height_pix: int) -> None:
        self.width_pix, self.height_pix = width_pix, height_pix
        size_inches = (width_pix / DPI, height_pix / DPI)
        self.figure = Figure(figsize=size_inches, dpi=DPI, facecolor="white")
        self._pictures: list[tuple[Pixels, tuple[int, int]]] = []

    def text(self, u: float, v: float, content: str, **style) -> None:
        """Text whose middle is at height ``v``; ``style`` is matplotlib's."""
        style = {"va": "center", "color": INK, **style}
        self.figure.text(u / self.width_pix, 1 - v / self.height_pix, content, **style)

    def picture(self, pixels: Pixels, u: int, v: int) -> None:
        """A picture, pixel by pixel, with its upper left corner at a place."""
        self._pictures.append((pixels, (u, v)))

    def legend(
        self,
        v: float,
        u: float | None = None,
        columns: int | None = None,
        size: float = 16,
        skip: Sequence[str] = (),
    ) -> None:
        """The classes' colors with their names, in letters of a size in points, around a place.

        Without ``u`` it is in the middle of the page, and without ``columns`` in one line.
        """
        patches = [
            Patch(facecolor=np.array(COLORS[name]) / 255, edgecolor="#9aa0a8", label=readable(name))
            for name in CLASSES
            if name not in skip
        ]

        self.figure.legend(
            handles=patches,
            loc="center",
            bbox_to_anchor=(0.5 if u is None else u / self.width_pix, 1 - v / self.height_pix),
            ncols=columns or len(patches),
            frameon=False,
            fontsize=size,
            handlelength=1.1,
            handleheight=1.0,
            columnspacing=1.6,
            handletextpad=0.5,
        )

    def drawn(self) -> Image.Image:
        """The page as it is now."""
        # Inches are rounded to pixels upwards now and then.
        page = image_of(self.figure).crop((0, 0, self.width_pix, self.height_pix))
        # Pasted, not drawn: matplotlib loses the last column of pixels where inches are rounded.
        for pixels, corner in self._pictures:
            page.paste(Image.fromarray(pixels), corner)
        return page


def readable(name: str) -> str:
    """A class, town or weather in words."""
    return name.upper() if name == "vru" else name.replace("_", " ")


def resized(picture: Pixels, width_pix: int | None = None, height_pix: int | None = None) -> Pixels:
    """A picture at another size, sharp. A side that is not given keeps the picture's shape."""
    height, width = picture.shape[:2]
    size_pix = (
        round(height_pix * width / height) if width_pix is None else width_pix,
        round(width_pix * height / width) if height_pix is None else height_pix,
    )
    return np.asarray(Image.fromarray(picture).resize(size_pix, Image.Resampling.LANCZOS))


def beside(pictures: Sequence[Pixels], gap_pix: int) -> Pixels:
    """Pictures of one height from left to right, with white gaps between them."""
    gap = np.full((pictures[0].shape[0], gap_pix, 3), 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def write_picture(image: Image.Image, path: str | Path, max_bytes: int | None = None) -> None:
    """Writes a JPEG or a PNG, by the suffix of the path, of at most some bytes.

    A JPEG that is too heavy gets less quality, down to 40; a PNG gets smaller. Raises `UserError`
    for a path that cannot be written.
    """
    suffix = Path(path).suffix
    max_bytes = max_bytes or MAX_BYTES[suffix]
    if suffix == ".jpg":
        content = _small_jpeg(image, max_bytes)
    else:
        content = within_bytes([image], _png, max_bytes)

    with replacing(path) as temporary:
        temporary.write_bytes(content)


def within_bytes(
    pictures: list[Image.Image], encode: Callable[[list[Image.Image]], bytes], max_bytes: int
) -> bytes:
    """Encodes pictures of one size, and smaller ones where the whole ones are too heavy."""
    content = encode(pictures)
    while len(content) > max_bytes:
        share = max(0.5, min(0.95, (max_bytes / len(content)) ** 0.5))
        size_pix = (int(pictures[0].width * share), int(pictures[0].height * share))
        pictures = [picture.resize(size_pix, Image.Resampling.LANCZOS) for picture in pictures]
        content = encode(pictures)

    return content


def _png(pictures: list[Image.Image]) -> bytes:
    return encoded(pictures[0], "PNG", optimize=True)


def _small_jpeg(image: Image.Image, max_bytes: int) -> bytes:
    for quality in QUALITIES:
        content = encoded(image, "JPEG", quality=quality, optimize=True, progressive=True)
        if len(content) <= max_bytes:
            break

    return content
