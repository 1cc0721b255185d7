from __future__ import annotations

import io
from base64 import b64encode
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pointkit.errors import InputError

if TYPE_CHECKING:
    from PIL.Image import Image as Pixels

WIDTHS = (1600, 1200, 800)
"""Widths of pictures, in pixels; the first that gives a small enough file is used, else the last.
"""
MOST_BYTES = 400_000
_COLOURS = 256


@dataclass(frozen=True)
class Picture:
    """A picture that is embedded in the page: PNG file, and its size in pixels."""

    png: bytes
    width: int
    height: int

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return "data:image/png;base64," + b64encode(self.png).decode("ascii")


def embedded(png: bytes, what: str) -> Picture:
    """Reduce a picture so that it can be embedded in the page.

    Parameters
    ----------
    png
        Content of a PNG file.
    what
        Name of the picture in the error message.

    Returns
    -------
    Picture
        The picture with at most 256 colours, in the largest of `WIDTHS` that gives at most
        `MOST_BYTES`.

    Raises
    ------
    InputError
        The picture is unreadable.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(png)) as image:
            whole = image.convert("RGBA")
    except (UnidentifiedImageError, OSError) as error:
        raise InputError(f"{what}: not a readable picture ({error})") from error
    flat = Image.new("RGB", whole.size, "white")
    flat.paste(whole, mask=whole.getchannel("A"))
    for width in WIDTHS:
        picture = _narrowed(flat, width)
        if len(picture.png) <= MOST_BYTES:
            break
    return picture


def _narrowed(image: Pixels, width: int) -> Picture:
    from PIL import Image

    height = max(1, round(image.height * min(1.0, width / image.width)))
    size = min(width, image.width), height
    small = image if size == image.size else image.resize(size, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.quantize(_COLOURS, dither=Image.Dither.NONE).save(buffer, format="PNG")
    return Picture(buffer.getvalue(), *size)
