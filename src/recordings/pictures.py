"""Images of a recording, read by value: colors, depth, ids. Every error names the file."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageOps

from ..errors import UserError

Size = tuple[int, int]

# What PIL calls 16 bits a pixel, in either byte order.
_DEEP = ("I;16", "I;16B", "I;16L", "I")


def files_of(folder: Path, *endings: str) -> list[Path]:
    """Returns a folder's files with one of the endings, by name. Raises `UserError` for none."""
    found = sorted(path for path in folder.glob("*") if path.name.endswith(endings))
    if not found:
        raise UserError(f"{folder}: holds no *{' or *'.join(endings)}")
    return found


def read_rgb(path: Path, size_pix: Size) -> UInt8[np.ndarray, "h w 3"]:
    """Reads a color image, turned as its EXIF data say; grey becomes RGB, transparency is left out.

    Raises `UserError` for 16-bit images, another size, and a file that cannot be read.
    """
    image = ImageOps.exif_transpose(_opened(path))
    if image.mode in _DEEP:
        raise UserError(f"{path}: has 16 bits a pixel; give 8-bit images")
    return np.asarray(_of_size(path, image, size_pix).convert("RGB"))


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
    """Returns width and height of a color image, turned as its EXIF data say."""
    return ImageOps.exif_transpose(_opened(path)).size


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
    try:
        with path.open("rb") as file:
            image = Image.open(file)
            image.load()
            return image
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        reason = "it is empty" if path.is_file() and not path.stat().st_size else error
        raise UserError(f"{path}: cannot be read as an image ({reason})") from error


def _of_size(path: Path, image: Image.Image, size_pix: Size) -> Image.Image:
    if image.size != size_pix:
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
