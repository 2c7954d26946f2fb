"""A white page on which text and pictures are placed to the pixel, and pictures as small files."""

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from ..atomic import replacing
from ..ontology import CLASSES, COLORS

DPI = 100
INK, MUTED = "#181c24", "#5a606a"

# How heavy a figure may be, by the suffix of its path.
MAX_BYTES = {".png": 1_500_000, ".jpg": 500_000}
# Of a JPEG: with less, letters and the edges of voxels blur.
QUALITY = 85
# Of pictures in rows: the white between them, and the height and the letters of their titles.
GAP_PIX, TITLE_PIX, TITLE_SIZE = 8, 32, 13

Pictures = list[Image.Image]
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
        called: Mapping[str, str] | None = None,
    ) -> None:
        """The classes' colors with their names, or what they are ``called`` here, in letters of a
        size in points, around a place.

        Without ``u`` it is in the middle of the page, and without ``columns`` in one line.
        """
        names = [name for name in CLASSES if name not in skip]
        colors = np.array([COLORS[name] for name in names]) / 255
        patches = [Patch(facecolor=color, edgecolor="#9aa0a8") for color in colors]

        place = (0.5 if u is None else u / self.width_pix, 1 - v / self.height_pix)
        style = {"loc": "center", "frameon": False, "handlelength": 1.1, "handleheight": 1.0}
        style |= {"columnspacing": 1.6, "handletextpad": 0.5, "ncols": columns or len(patches)}

        labels = [(called or {}).get(name, readable(name)) for name in names]
        self.figure.legend(patches, labels, bbox_to_anchor=place, fontsize=size, **style)

    def drawn(self) -> Image.Image:
        """The page as it is now."""
        # Inches are rounded to pixels upwards now and then.
        page = _image_of(self.figure).crop((0, 0, self.width_pix, self.height_pix))
        # Pasted, not drawn: matplotlib loses the last column of pixels where inches are rounded.
        for pixels, corner in self._pictures:
            page.paste(Image.fromarray(pixels), corner)
        return page


def titled_sheet(
    rows: Sequence[Sequence[tuple[str, Pixels]]],
    cell_width_pix: int | None = None,
    header_pix: int = 0,
    footer_pix: int = 0,
    title_size: int = TITLE_SIZE,
) -> Canvas:
    """Places rows of titled pictures on a page, below a header and above a footer that are empty.

    All pictures are scaled to ``cell_width_pix``; without it they keep their sizes.
    """
    if cell_width_pix:
        rows = [[(title, resized(each, cell_width_pix)) for title, each in row] for row in rows]
    title_pix = TITLE_PIX * title_size // TITLE_SIZE
    widths = [GAP_PIX + sum(each.shape[1] + GAP_PIX for _, each in row) for row in rows]
    heights = [title_pix + max(each.shape[0] for _, each in row) for row in rows]
    page = Canvas(max(widths), header_pix + sum(heights) + GAP_PIX + footer_pix)

    top = header_pix
    for row, height in zip(rows, heights):
        left = GAP_PIX
        for title, picture in row:
            page.text(left + 2, top + 0.55 * title_pix, title, size=title_size)
            page.picture(picture, left, top + title_pix)
            left += picture.shape[1] + GAP_PIX
        top += height
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


def write_figure(figure: Figure, path: str | Path) -> None:
    """Writes a PNG of 256 colors, which is a third of the bytes that a plot has with all colors.

    Raises `UserError` for a path that cannot be written.
    """
    write_picture(_image_of(figure).quantize(256), path)


def write_picture(image: Image.Image, path: str | Path, max_bytes: int | None = None) -> None:
    """Writes a JPEG or a PNG, by the suffix of the path, of at most some bytes.

    A picture that is too heavy gets smaller. Raises `UserError` for a path that cannot be written.
    """
    suffix = Path(path).suffix
    kind = Image.registered_extensions()[suffix]
    encode = partial(encoded, kind=kind, optimize=True, quality=QUALITY, progressive=True)
    write_light([image], path, lambda images: encode(*images), max_bytes or MAX_BYTES[suffix])


def write_light(
    pictures: Pictures, path: str | Path, encode: Callable[[Pictures], bytes], max_bytes: int
) -> None:
    """Writes pictures of one size as one file, and smaller ones where that is too heavy."""
    content = encode(pictures)
    while len(content) > max_bytes:
        share = max(0.5, min(0.95, (max_bytes / len(content)) ** 0.5))
        size_pix = (int(pictures[0].width * share), int(pictures[0].height * share))
        pictures = [picture.resize(size_pix, Image.Resampling.LANCZOS) for picture in pictures]
        content = encode(pictures)

    with replacing(path) as temporary:
        temporary.write_bytes(content)


def encoded(image: Image.Image, kind: str, **options: object) -> bytes:
    """Returns the bytes of a file of a kind, such as JPEG; ``options`` are those of Pillow."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def address(content: bytes, kind: str) -> str:
    """Returns a ``data:`` address that holds a whole picture of a kind, as ``image/png``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _image_of(figure: Figure) -> Image.Image:
    """Draws a figure in RGB."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
