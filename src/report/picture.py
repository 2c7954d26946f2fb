"""Pictures as bytes, and embedded in a page."""

import base64
import io

from PIL import Image


def encoded(image: Image.Image, kind: str, **options: object) -> bytes:
    """Returns the bytes of a file of a kind, such as JPEG; ``options`` are those of Pillow."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def address(content: bytes, kind: str) -> str:
    """Returns a ``data:`` address that holds a whole picture of a kind, as ``image/png``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
