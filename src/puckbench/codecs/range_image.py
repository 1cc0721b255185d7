"""A sensor's turns as images of ranges, lasers by firing columns, for codecs of images.

Rows are lasers from the highest down, columns firings; pixels have 16 bits, 0 where no return came.
A stream is framed (`common.framing`), its parts each with their length in front, base 128:

    the layout (`puck.layout`)
    the beams and the quantum (`puck.beams`)
    the quanta of a cell, the number of turns, the blocks of each, base 128
    azimuths: how each differs from the one before (16 bits, zigzag), low bytes first, by Zstandard
    an image for each turn and kind of return, by the codec of images

Times and reflectivities are not in it.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.base import Availability, Pace, Parameters, lengths
from puckbench.codecs.returns_codec import ReturnsCodec, step_in_quanta
from puckbench.coding.byte_io import Reader, base_128
from puckbench.coding.framing import Framing
from puckbench.coding.most_points import most_points
from puckbench.coding.zstandard import compressed, decompressed
from puckbench.core.errors import InputError
from puckbench.lidar.returns import Returns
from puckbench.lidar.turns import Layout, Turn
from puckbench.puck.beams import packed_beams, unpacked_beams
from puckbench.puck.layout import packed, unpacked

Image = NDArray[np.uint16]
_MOST_QUANTA = 1 << 15
_PIXELS_PER_BYTE = 4096
_FEW_PIXELS = 1 << 20


class RangeImageCodec(ReturnsCodec):
    """Ranges as images of a well-known format, by imagecodecs; a subclass names the format.

    A rate is a cell of ranges, from 1 quantum on; that of one quantum is without loss. Of two
    returns of a beam the second image has 0 where they are the same.
    """

    metric_rates = lengths(100, 50, 20, 10, 4, 2)
    pace = Pace(0.05, 10.0)

    @abstractmethod
    def _image_encoded(self, image: Image, quanta: int) -> bytes:
        """Numbers (rows, columns) of cells of a number of quanta, without loss."""

    @abstractmethod
    def _image_decoded(self, stream: bytes, shape: tuple[int, int], quanta: int) -> Image:
        """The inverse of `_image_encoded`; InputError for a damaged stream or another shape."""

    def available(self) -> Availability:
        """Whether imagecodecs is installed."""
        found = find_spec("imagecodecs") is not None
        return Availability(found, "" if found else "imagecodecs is not installed (pip)")

    @property
    def version(self) -> str:
        """That of imagecodecs, which says which libraries are in it."""
        from importlib.metadata import version

        return f"imagecodecs {version('imagecodecs')}" if self.available().ok else ""

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        layout = returns.layout
        quanta = min(step_in_quanta(returns, parameters), _MOST_QUANTA)
        numbers = [quanta, len(returns.turns), *(len(turn.azimuths) for turn in returns.turns)]
        images = [image for turn in returns.turns for image in _images(turn, layout, quanta)]
        parts = [
            packed(layout),
            packed_beams(returns),
            b"".join(base_128(number) for number in numbers),
            _packed_azimuths(np.concatenate([turn.azimuths for turn in returns.turns])),
            *(self._image_encoded(image, quanta) for image in images),
        ]
        body = b"".join(base_128(len(part)) + part for part in parts)
        _check_pixels(sum(image.size for image in images), body)
        return self._framing.framed(body)

    def _decode_returns(self, stream: bytes) -> Returns:
        reader = Reader(self._framing.unframed(stream)[1])
        layout = unpacked(_part(reader))[0]
        bare = unpacked_beams(_part(reader), layout)
        quanta, blocks = _numbers(Reader(_part(reader)))
        if any(not 0 < count <= layout.max_blocks for count in blocks):
            raise InputError("the stream is damaged (its turns)")
        columns = [count * layout.columns_per_block for count in blocks]
        _check_pixels(sum(columns) * layout.lasers * layout.kinds, reader.body)
        azimuths = np.split(_unpacked_azimuths(_part(reader), sum(blocks)), np.cumsum(blocks)[:-1])
        turns = []
        for width, azimuth in zip(columns, azimuths, strict=True):
            shape = (layout.lasers, width)
            images = [
                self._image_decoded(_part(reader), shape, quanta) for _ in range(layout.kinds)
            ]
            turns.append(_turn(images, azimuth, layout, quanta))
        if reader.rest():
            raise InputError("the stream is damaged (bytes at its end)")
        return replace(bare, turns=tuple(turns))


def _part(reader: Reader) -> bytes:
    return reader.take(reader.number())


def _numbers(reader: Reader) -> tuple[int, list[int]]:
    """The quanta of a cell, and the blocks of each turn, at least one."""
    quanta, turns = reader.number(), reader.number()
    if not 0 < quanta <= _MOST_QUANTA or not 0 < turns <= len(reader.body):
        raise InputError("the stream is damaged (its numbers)")
    return quanta, [reader.number() for _ in range(turns)]


def _check_pixels(pixels: int, body: bytes) -> None:
    """Refuse more pixels than any stream of the length holds, before memory is taken."""
    if pixels > min(_FEW_PIXELS + _PIXELS_PER_BYTE * len(body), most_points(len(body))):
        raise InputError(f"{pixels} pixels in {len(body)} bytes: more than they may hold")


def _images(turn: Turn, layout: Layout, quanta: int) -> list[Image]:
    """Numbers of cells of each kind of return, (lasers, columns)."""
    ranges = turn.ranges.astype(np.int64)[:, :, list(layout.order)[::-1]].transpose(0, 2, 1)
    cells = np.where(ranges > 0, (ranges - 1) // quanta + 1, 0).astype(np.uint16)
    found = [np.ascontiguousarray(cells[0])]
    if layout.kinds == 2:
        found.append(_swapped(cells[1], cells[0]))
    return found


def _swapped(image: Image, first: Image) -> Image:
    """The second image with 0 and the first one's numbers exchanged; its own inverse."""
    return np.where(image == first, 0, np.where(image == 0, first, image)).astype(np.uint16)


def _turn(images: list[Image], azimuths: NDArray[np.uint16], layout: Layout, quanta: int) -> Turn:
    """The turn of images, ranges in the middle of their cells."""
    cells = np.stack([images[0], *(_swapped(other, images[0]) for other in images[1:])])
    middle = (cells.astype(np.int64) - 1) * quanta + 1 + (quanta - 1) // 2
    ranges = np.zeros((layout.kinds, cells.shape[2], layout.lasers), np.uint16)
    known = np.where(cells > 0, np.minimum(middle, 0xFFFF), 0).astype(np.uint16)
    ranges[:, :, list(layout.order)[::-1]] = known.transpose(0, 2, 1)
    return Turn(ranges, azimuths)


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
