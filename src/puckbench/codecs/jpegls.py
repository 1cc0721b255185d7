"""The codec `jpegls`: range images compressed by JPEG-LS (ITU-T T.87), with imagecodecs and CharLS.

A lossy rate rounds ranges to a step of several quanta, i.e. range units of the sensor. JPEG-LS
codes the rounded ranges, in quanta, with errors below half a step. So the decoder can recover them
exactly. Lossless coding in multiples of the step would take more bits, since JPEG-LS contexts
distinguish small values less well.
"""

from __future__ import annotations

import numpy as np

from pointkit.errors import InputError
from puckbench.codecs.range_image import RangeImageCodec
from puckbench.codecs.registry import CODECS
from puckbench.codecs.storage.range_images import Image

CODE = ("puckbench.codecs.range_image",)

_MOST_NEAR = 255
_END = b"\xff\xd9"
"""End marker of JPEG-LS; CharLS 2.4 takes seconds to reject streams without it."""


@CODECS.register("jpegls")
class JpegLs(RangeImageCodec):
    """The codec compresses range images, rounded to the step of the rate, by JPEG-LS."""

    magic = b"PBJL"

    def _image_encoded(self, image: Image, quanta: int) -> bytes:
        from imagecodecs import jpegls_encode

        ends = image.astype(np.int64) * quanta
        level = min((quanta - 1) // 2, _MOST_NEAR) if ends.max() <= 0xFFFF else 0
        coded = ends.astype(np.uint16) if level else image
        return bytes([level]) + bytes(jpegls_encode(coded, level=level))

    def _image_decoded(self, stream: bytes, shape: tuple[int, int], quanta: int) -> Image:
        from imagecodecs import jpegls_decode

        level, coded = stream[:1], stream[1:]
        pixels = np.zeros(shape, np.uint16)
        try:
            jpegls_decode(coded + _END, out=pixels)
        except (RuntimeError, ValueError, TypeError, MemoryError) as error:
            raise InputError("the stream is damaged (JPEG-LS)") from error
        if level in (b"", b"\0"):
            return pixels
        return ((pixels.astype(np.int64) + level[0]) // quanta).astype(np.uint16)
