"""An encoded picture, embedded in the page."""

import base64
import io
from dataclasses import dataclass

from PIL import Image

from ..errors import UserError

SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""The first bytes of a file, and what it then is."""


@dataclass(frozen=True)
class Picture:
    """The bytes of a PNG or a JPEG, and what is said below it."""

    encoded: bytes
    caption: str

    @classmethod
    def jpeg(cls, image: Image.Image, caption: str, quality: int) -> "Picture":
        """A JPEG of an image."""
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=quality, optimize=True)
        return cls(buffer.getvalue(), caption)

    @property
    def size_pix(self) -> tuple[int, int]:
        """Width and height. Raises `UserError` where the bytes are no picture."""
        try:
            with Image.open(io.BytesIO(self.encoded)) as image:
                return image.size
        except OSError as error:
            raise self._broken() from error

    @property
    def address(self) -> str:
        """A ``data:`` address that holds the whole picture.

        Raises `UserError` where the bytes are neither a PNG nor a JPEG.
        """
        for signature, kind in SIGNATURES.items():
            if self.encoded.startswith(signature):
                return f"data:{kind};base64,{base64.b64encode(self.encoded).decode('ascii')}"
        raise self._broken()

    def _broken(self) -> UserError:
        return UserError(f"picture {self.caption!r}: is neither a PNG nor a JPEG; draw it again")
