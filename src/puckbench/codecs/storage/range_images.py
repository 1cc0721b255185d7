"""Encoder and decoder of turns as range images: a row for each laser, a column for each firing.

The highest laser is the first row; the layout specifies shifts of rows. Pixels of 16 bits count
range steps from 1; 0 means no return. Pixels of 32 bits are split into two images, of the lower and
of the upper 16 bits. A stream's body has these parts, each after its length, base 128:

    the layout (`lidar.returns_header`)
    the beams and the quantum (`lidar.returns_header`)
    the quanta of a step (plus 2^16 for pixels of 32 bits), the number of turns, the blocks of each
        turn, base 128
    differences between successive azimuths (16 bits, zigzag), low bytes first, by Zstandard
    an image for each turn and kind of return, by an image codec
    if 2^17 is added to the quanta: an image of reflectivities for each turn and kind of return; a
        pixel without a return repeats its left neighbour or, in the second image, is 0
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from pointkit.lidar.turns import (
    MAX_RANGE,
    Layout,
    Ranges,
    Turn,
    by_elevation,
    by_laser,
    has_wide_ranges,
)
from puck.returns_header import decode_beams, decode_layout, encode_beams, encode_layout
from puckbench.codecs.most_points import most_points

Image = NDArray[np.uint16]
EncodeImage = Callable[[Image, int], bytes]
"""Function that encodes an image (rows, columns) losslessly. Its second argument is the number
of quanta (range units of the sensor) that a pixel value stands for."""
DecodeImage = Callable[[bytes, tuple[int, int], int], Image]
"""Function that decodes an image. Its arguments are the stream, the shape, and the quanta per
pixel value. It raises InputError if the stream is damaged or has another shape."""
_MAX_QUANTA = 1 << 15
_WIDE, _REFLECTIVITIES = 1 << 16, 1 << 17
_PIXELS_PER_BYTE = 4096
_FEW_PIXELS = 1 << 20


def encode_range_images(
    returns: Returns, quanta: int, encode_image: EncodeImage, reflectivities: bool = False
) -> bytes:
    """Encode the returns of a spinning sensor as range images.

    A sensor with two returns per beam gives two images. In the second image, a pixel is 0 if both
    returns are equal.

    Parameters
    ----------
    returns
        The returns to encode.
    quanta
        Step to which ranges are rounded, in quanta (range units of the sensor).
    encode_image
        Function that encodes an image.
    reflectivities
        Whether reflectivities are encoded too, if all turns have them.

    Returns
    -------
    bytes
        The body of a stream, as the module describes it.
    """
    layout, turns = returns.layout, returns.turns
    quanta = min(quanta, _MAX_QUANTA)
    is_wide = any(map(has_wide_ranges, turns))
    shades = [image for turn in turns for image in _shades(turn, layout)] if reflectivities else []
    flags = is_wide * _WIDE | bool(shades) * _REFLECTIVITIES
    numbers = [quanta | flags, len(turns), *(len(turn.azimuths) for turn in turns)]
    pixels = [image for turn in turns for image in _images(turn, layout, quanta)]
    images = [
        (image >> shift & 0xFFFF).astype(np.uint16)
        for image in pixels
        for shift in ((0, 16) if is_wide else (0,))
    ]
    parts = [
        encode_layout(layout),
        encode_beams(returns),
        b"".join(base_128(number) for number in numbers),
        _packed_azimuths(np.concatenate([turn.azimuths for turn in turns])),
        *(encode_image(image, quanta) for image in images),
        *(encode_image(image, 1) for image in shades),
    ]
    body = b"".join(base_128(len(part)) + part for part in parts)
    _check_pixels(sum(image.size for image in [*images, *shades]), body)
    return body


def decode_range_images(body: bytes, decode_image: DecodeImage) -> Returns:
    """Decode the returns in a stream's body.

    Parameters
    ----------
    body
        Result of `encode_range_images`.
    decode_image
        Function that decodes an image.

    Raises
    ------
    InputError
        The body is damaged.
    """
    reader = Reader(body)
    layout = decode_layout(_part(reader))[0]
    bare = decode_beams(_part(reader), layout)
    quanta, flags, blocks = _numbers(Reader(_part(reader)))
    is_wide, has_shades = bool(flags & _WIDE), bool(flags & _REFLECTIVITIES)
    each = layout.kinds * (2 if is_wide else 1)
    if any(not 0 < count <= layout.max_blocks for count in blocks):
        raise InputError("the stream is damaged (its turns)")
    columns = [count * layout.columns_per_block for count in blocks]
    _check_pixels(sum(columns) * layout.lasers * (each + has_shades * layout.kinds), reader.body)
    azimuths = np.split(_unpacked_azimuths(_part(reader), sum(blocks)), np.cumsum(blocks)[:-1])
    turns = []
    for width, azimuth in zip(columns, azimuths, strict=True):
        shape = (layout.lasers, width)
        images: list[Ranges] = [decode_image(_part(reader), shape, quanta) for _ in range(each)]
        if is_wide:
            pairs = zip(images[::2], images[1::2], strict=True)
            images = [(low + high * np.uint32(1 << 16)).astype(np.uint32) for low, high in pairs]
        turns.append(_turn(images, azimuth, layout, quanta))
    if has_shades:
        for k, turn in enumerate(turns):
            shape = (layout.lasers, turn.ranges.shape[1])
            images = [decode_image(_part(reader), shape, 1) for _ in range(layout.kinds)]
            turns[k] = replace(turn, reflectivities=_reflectivities(images, turn, layout))
    if reader.rest():
        raise InputError("the stream is damaged (bytes at its end)")
    return replace(bare, turns=tuple(turns))


def reflectivity_bytes(body: bytes) -> int:
    """Return how many bytes of a stream's body the reflectivities take."""
    reader = Reader(body)
    layout = decode_layout(_part(reader))[0]
    _part(reader)
    flags, blocks = _numbers(Reader(_part(reader)))[1:]
    for _ in range(1 + len(blocks) * layout.kinds * (2 if flags & _WIDE else 1)):
        _part(reader)
    return len(reader.rest())


def _part(reader: Reader) -> bytes:
    return reader.take(reader.number())


def _numbers(reader: Reader) -> tuple[int, int, list[int]]:
    quanta, turns = reader.number(), reader.number()
    flags, quanta = quanta & (_WIDE | _REFLECTIVITIES), quanta & ~(_WIDE | _REFLECTIVITIES)
    if not 0 < quanta <= _MAX_QUANTA or not 0 < turns <= len(reader.body):
        raise InputError("the stream is damaged (its numbers)")
    return quanta, flags, [reader.number() for _ in range(turns)]


def _check_pixels(pixels: int, body: bytes) -> None:
    """Raise InputError if the number of pixels is implausible, before memory is allocated."""
    if pixels > min(_FEW_PIXELS + _PIXELS_PER_BYTE * len(body), most_points(len(body))):
        raise InputError(f"{pixels} pixels in {len(body)} bytes: more than they can hold")


def _images(turn: Turn, layout: Layout, quanta: int) -> list[Ranges]:
    ranges = by_elevation(turn.ranges.astype(np.int64), layout)[:, :, ::-1].transpose(0, 2, 1)
    steps: Ranges = np.where(ranges > 0, (ranges - 1) // quanta + 1, 0).astype(turn.ranges.dtype)
    images = [np.ascontiguousarray(steps[0])]
    if layout.kinds == 2:
        images.append(_swapped(steps[1], steps[0]))
    return images


def _shades(turn: Turn, layout: Layout) -> list[Image]:
    if turn.reflectivities is None:
        return []
    values, has_return = (
        by_elevation(part, layout)[:, :, ::-1].transpose(0, 2, 1)
        for part in (turn.reflectivities.astype(np.uint16), turn.ranges > 0)
    )
    columns = np.where(has_return, np.arange(values.shape[2]), 0)
    filled = np.take_along_axis(values, np.maximum.accumulate(columns, axis=2), axis=2)
    others = np.where(has_return, values, filled[0])[1:]
    return [filled[0], *(_swapped(other, filled[0]).astype(np.uint16) for other in others)]


def _reflectivities(images: Sequence[Ranges], turn: Turn, layout: Layout) -> NDArray[np.uint8]:
    values = np.stack([images[0], *(_swapped(other, images[0]) for other in images[1:])])
    if values.max(initial=0) > 0xFF:
        raise InputError("the stream is damaged (its reflectivities)")
    placed = by_laser(values.astype(np.uint8).transpose(0, 2, 1)[:, :, ::-1], layout)
    return np.where(turn.ranges > 0, placed, np.uint8(0))


def _swapped(image: Ranges, first: Ranges) -> Ranges:
    """Replace 0 by the first image's value in each pixel, and this value by 0.

    A second call restores the image.
    """
    other = np.where(image == 0, first, image)
    swapped: Ranges = np.where(image == first, 0, other).astype(image.dtype)
    return swapped


def _turn(
    images: Sequence[Ranges], azimuths: NDArray[np.uint16], layout: Layout, quanta: int
) -> Turn:
    steps = np.stack([images[0], *(_swapped(other, images[0]) for other in images[1:])])
    middle = (steps.astype(np.int64) - 1) * quanta + 1 + (quanta - 1) // 2
    farthest = MAX_RANGE if steps.dtype == np.uint32 else 0xFFFF
    pixels = np.where(steps > 0, np.minimum(middle, farthest), 0).astype(steps.dtype)
    return Turn(by_laser(pixels.transpose(0, 2, 1)[:, :, ::-1], layout), azimuths)


def _packed_azimuths(azimuths: NDArray[np.uint16]) -> bytes:
    rises = np.diff(azimuths, prepend=np.uint16(0)).astype(np.int16).astype(np.int64)
    zigzag = np.where(rises >= 0, 2 * rises, -2 * rises - 1).astype("<u2")
    return compressed(np.ascontiguousarray(zigzag.view(np.uint8).reshape(-1, 2).T).tobytes())


def _unpacked_azimuths(data: bytes, count: int) -> NDArray[np.uint16]:
    planes = np.frombuffer(decompressed(data, 2 * count), np.uint8)
    if len(planes) != 2 * count:
        raise InputError("the stream is damaged (its azimuths)")
    zigzag = planes.reshape(2, -1).T.copy().view("<u2")[:, 0].astype(np.int64)
    rises = (zigzag >> 1) ^ -(zigzag & 1)
    return np.cumsum(rises).astype(np.uint16)
