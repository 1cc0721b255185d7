from __future__ import annotations

import numpy as np
from pydantic import Field

from pointkit.errors import InputError
from puckbench.codecs.range_image import RangeImageCodec, RangeImageOptions
from puckbench.codecs.registry import CODECS
from puckbench.codecs.storage.range_images import Image

CODE = ("puckbench.codecs.range_image",)

_BOX = b"jxlc"


class JpegXlOptions(RangeImageOptions):
    effort: int = Field(
        10, ge=1, le=10, description="effort of the encoder; 10 gives the smallest streams"
    )


@CODECS.register("jpegxl")
class JpegXl(RangeImageCodec):
    """The codec compresses range images, rounded to the step of the rate, losslessly by JPEG XL."""

    magic = b"PBJX"
    Options = JpegXlOptions
    options: JpegXlOptions

    def _image_encoded(self, image: Image, quanta: int) -> bytes:
        from imagecodecs import jpegxl_encode

        effort = self.options.effort
        stream = bytes(jpegxl_encode(image, lossless=True, effort=effort, numthreads=1))
        at = stream.find(_BOX)
        return stream[at + len(_BOX) :] if stream[:1] == b"\0" and at > 0 else stream

    def _image_decoded(self, stream: bytes, shape: tuple[int, int], quanta: int) -> Image:
        from imagecodecs import jpegxl_decode

        pixels = np.zeros(shape, np.uint16)
        try:
            jpegxl_decode(stream, numthreads=1, out=pixels)
        except (RuntimeError, ValueError, TypeError, MemoryError) as error:
            raise InputError("the stream is damaged (JPEG XL)") from error
        return pixels
