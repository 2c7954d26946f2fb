"""Images, read by value: colors, depth, ids. Every error names the file."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageOps

from ..errors import UserError, reason_of

Size = tuple[int, int]

# EXIF's tag of the orientation, and the values of it that exchange width and height.
ORIENTATION, ON_ITS_SIDE = 0x0112, (5, 6, 7, 8)
# What PIL calls 16 bits a pixel, in either byte order.
_DEEP = ("I;16", "I;16B", "I;16L", "I")


def files_of(folder: Path, *endings: str) -> list[Path]:
    """Returns a folder's files with one of the endings, by name, in which a number counts as one.
    Raises `UserError` for none."""
    found = [path for path in folder.glob("*") if path.name.endswith(endings)]
    if not found:
        raise UserError(f"{folder}: holds no *{' or *'.join(endings)}")
    return sorted(found, key=in_order)


def in_order(path: Path) -> tuple[list[str | int], str]:
    """Returns a key that sorts 9 before 10, however many zeros there are."""
    parts = re.split(r"(\d+)", path.stem)
    return [int(part) if part.isdigit() else part for part in parts], path.name


def number_of(path: Path) -> int | None:
    """Returns the last number in a file's name; None without one."""
    numbers = re.findall(r"\d+", path.stem)
    return int(numbers[-1]) if numbers else None


def read_rgb(path: Path, size_pix: Size | None = None) -> UInt8[np.ndarray, "h w 3"]:
    """Reads an image as RGB, turned as its EXIF data say: grey becomes RGB, transparency is left
    out, and of 16 bits the higher ones are kept.

    Raises `UserError` for fractions of grey, another size, and a file that cannot be read.
    """
    image = ImageOps.exif_transpose(_opened(path))
    if image.mode in _DEEP:
        high = np.asarray(image).astype(np.int64) >> 8
        image = Image.fromarray(high.clip(0, 255).astype(np.uint8))
    elif image.mode == "F":
        raise UserError(f"{path}: holds fractions of grey; convert it to 8 bits")
    return np.array(_of_size(path, image, size_pix).convert("RGB"))


def read_ids(path: Path, size_pix: Size) -> Int[np.ndarray, "h w"]:
    """Reads a one-channel image of ids. Raises `UserError` for one of colors, and as `read_rgb`."""
    image = _of_size(path, _opened(path), size_pix)
    # A palette's indices are the ids; its colors are for people.
    if image.mode not in ("L", "P", "1", *_DEEP):
        raise UserError(f"{path}: holds colors ({image.mode}); give one channel of class ids")
    return np.asarray(image).astype(np.int64)


def read_channels(path: Path, size_pix: Size, mode: str) -> UInt8[np.ndarray, "h w c"]:
    """Reads the bytes of an image's channels. Raises `UserError` for another mode, and as above."""
    image = _opened(path)
    if image.mode != mode and {image.mode, mode} != {"RGB", "RGBA"}:
        raise UserError(f"{path}: is {image.mode}, and this layout has {mode}")
    return np.asarray(_of_size(path, image, size_pix))[..., : len(mode)]


def read_array(path: Path, size_pix: Size) -> Float[np.ndarray, "h w"]:
    """Reads numbers of a ``.npy``, a 16-bit ``.png`` in millimetres or a ``.pfm``.

    In a png 65535 is inf. Raises `UserError` with the file for another shape.
    """
    if path.suffix == ".npy":
        array = _loaded(path)
    elif path.suffix == ".pfm":
        array = _read_pfm(path)
    else:
        image = _opened(path)
        if image.mode not in _DEEP:
            raise UserError(f"{path}: is {image.mode}; depth in a png has 16 bits, in millimetres")
        raw = np.asarray(image).astype(np.float32)
        array = np.where(raw == 65535, np.inf, raw / 1000)

    if array.shape != size_pix[::-1]:
        wanted = f"{size_pix[0]}x{size_pix[1]}"
        raise UserError(f"{path}: is {'x'.join(map(str, array.shape[::-1]))}, images are {wanted}")
    return array.astype(np.float32)


def size_of(path: Path) -> Size:
    """Returns width and height of an image that is turned upright, from its first bytes alone."""
    with _begun(path) as image:
        # Of a PNG, all would be read to find none.
        lies = image.format != "PNG" and image.getexif().get(ORIENTATION) in ON_ITS_SIDE
        return image.size[::-1] if lies else image.size


def require_depth(path: Path, depth_m: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Returns a depth image. Raises `UserError` for one that holds NaN, zeros or less."""
    if not (depth_m > 0).all():
        share = 1 - (depth_m > 0).mean()
        raise UserError(
            f"{path}: {share:.1%} of its depths are zero, negative or no number; a surface has "
            "one above 0, and what nothing is hit has inf"
        )
    return depth_m


def _opened(path: Path) -> Image.Image:
    with _begun(path) as image:
        image.load()
        return image


@contextmanager
def _begun(path: Path) -> Iterator[Image.Image]:
    """Yields an image whose pixels are not read yet."""
    try:
        with Image.open(path) as image:
            yield image
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        is_empty = path.is_file() and not path.stat().st_size
        why = "is empty" if is_empty else f"cannot be read as an image ({reason_of(error)})"
        raise UserError(f"{path} {why}; remove it, or copy it again") from error


def _of_size(path: Path, image: Image.Image, size_pix: Size | None) -> Image.Image:
    if size_pix is not None and image.size != size_pix:
        ours, wanted = ("x".join(map(str, size)) for size in (image.size, size_pix))
        raise UserError(f"{path}: is {ours}, and the first image is {wanted}; give one size")
    return image


def _loaded(path: Path) -> np.ndarray:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path}: cannot be read as an array ({error})") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise UserError(f"{path}: holds no array of numbers")
    return array


def _read_pfm(path: Path) -> np.ndarray:
    """Reads a portable float map, whose rows go from the bottom up."""
    try:
        _, size, scale, data = path.read_bytes().split(b"\n", 3)
        width, height = map(int, size.split())
        array = np.frombuffer(data, "<f4" if float(scale) < 0 else ">f4").reshape(height, width)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read as a pfm of one channel ({error})") from error
    return array[::-1]
