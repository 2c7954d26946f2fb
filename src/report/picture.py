"""An encoded picture, embedded in the page."""

import base64
import io
from dataclasses import dataclass

from PIL import Image

from ..errors import UserError


def encoded(image: Image.Image, kind: str, **options: object) -> bytes:
    """Returns the bytes of a file of a kind, such as JPEG; ``options`` are those of Pillow."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


@dataclass(frozen=True)
class Picture:
    """The bytes of a PNG or a JPEG, and the caption below it."""

    encoded: bytes
    caption: str

    @classmethod
    def jpeg(cls, image: Image.Image, caption: str, quality: int) -> "Picture":
        """Encodes an image as a JPEG."""
        return cls(encoded(image, "JPEG", quality=quality, optimize=True), caption)

    @property
    def address(self) -> str:
        """A ``data:`` address that holds the whole picture.

        Raises `UserError` where the bytes are neither a PNG nor a JPEG.
        """
        try:
            # An SVG could hold scripts, and other formats do not open in every browser.
            with Image.open(io.BytesIO(self.encoded), formats=("PNG", "JPEG")) as image:
                kind = image.get_format_mimetype()
        except OSError as error:
            raise UserError(
                f"picture {self.caption!r}: is neither a PNG nor a JPEG; draw it again"
            ) from error

        return f"data:{kind};base64,{base64.b64encode(self.encoded).decode('ascii')}"
