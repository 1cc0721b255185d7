"""Lossless coding of the data of successive PointCloud2 messages of one topic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.zstandard import compressed
from pointkit.errors import InputError
from puck.clouds.coding import PointCoder
from puck.clouds.layout import CloudField, CloudLayout, Shape, data_of, points_of, shape_of
from puck.clouds.rays import Rays
from puck.gaps import compress_bytes, decompress_bytes
from puck.options import EFFORTS, CodingOptions
from puck.records import check

__all__ = ["CloudDecoder", "CloudEncoder", "CloudField", "CloudLayout"]

_RAW, _POINTS, _SAME = range(3)
_QUICKLY, _SAMPLE, _CLOSE = 1, 1 << 16, 1.6
"""Level of Zstandard and bytes of a sample that tell whether LZMA may be better, and how near they
then come to the coded columns."""
_MOST_POINTS = 1 << 21
_NEEDS_ANOTHER = "the cloud needs the one before it"


class CloudEncoder:
    """Encoder of the data of successive messages with one layout."""

    def __init__(self, layout: CloudLayout, options: CodingOptions) -> None:
        self._layout, self._options = layout, options
        self._coder: PointCoder | None = None
        self._before: bytes | None = None
        self._rays: Rays | None = None

    def encode(self, data: bytes, width: int, height: int, row_step: int, *, is_key: bool) -> bytes:
        """Return bytes from which `CloudDecoder.decode` restores the data of a message.

        Parameters
        ----------
        data
            The data: points of `width` columns and `height` rows, or any other bytes.
        width, height, row_step
            Numbers of points in a row and of rows, and of bytes from one row to the next.
        is_key
            Whether the bytes can be decoded without those of earlier messages.
        """
        layout = self._layout
        if is_key:
            self._forget()
        elif data == self._before:
            return bytes([_SAME])
        self._before = data
        coded = self._points(data, shape_of(layout, len(data), width, height, row_step))
        if not coded or _quick_size(data) < _CLOSE * len(coded):
            raw = bytes([_RAW]) + compress_bytes(data)
            if not coded or len(raw) <= len(coded):
                self._forget()
                return raw
        return coded

    def _forget(self) -> None:
        """Let the next message not need earlier ones, whose rays are tried first nevertheless."""
        if self._coder is not None:
            self._rays, self._coder = self._coder.rays or self._rays, None

    def _points(self, data: bytes, shape: Shape) -> bytes:
        """Return points coded by their columns, or no bytes if the data have no points."""
        layout, effort = self._layout, self._options.effort
        if not layout.is_codable or not 0 < shape.rows * shape.columns <= _MOST_POINTS:
            return b""
        is_first = self._coder is None
        self._coder = self._coder or PointCoder(layout, effort, self._rays)
        points, rest = points_of(np.frombuffer(data, np.uint8), layout.point_step, shape)
        head = bytes([_POINTS | is_first << 4 | EFFORTS.index(effort) << 5])
        beside = compress_bytes(rest)
        coded = self._coder.encode(points, _width(shape))
        if not coded:
            return b""
        return head + b"".join(map(base_128, (*shape, len(beside)))) + beside + coded


class CloudDecoder:
    """Decoder of the bytes of a `CloudEncoder`, in the same order, starting with a key message."""

    def __init__(self, layout: CloudLayout) -> None:
        self._layout = layout
        self._coder: PointCoder | None = None
        self._before: bytes | None = None

    def decode(self, body: bytes, admit: Callable[[int], None]) -> bytes:
        """Return the data of a message.

        Parameters
        ----------
        body
            Bytes that `CloudEncoder.encode` returned.
        admit
            Function that is called with a number of bytes before they are decoded. It raises
            InputError if they are too many.

        Raises
        ------
        InputError
            The bytes are damaged, or need the message before them.
        """
        coder, before = self._coder, self._before
        self._coder = self._before = None  # no other message may use what a damaged one left
        head = body[0] if body else _RAW
        if head == _SAME:
            if before is None:
                raise InputError(_NEEDS_ANOTHER)
            check(len(body) == 1)
            admit(len(before))
            data = before
        elif head & 15 == _POINTS:
            coder, data = self._decode_points(coder, body, admit)
        else:
            check(head == _RAW)
            coder, data = None, decompress_bytes(Reader(body[1:]), admit)
        self._coder, self._before = coder, data
        return data

    def _decode_points(
        self, coder: PointCoder | None, body: bytes, admit: Callable[[int], None]
    ) -> tuple[PointCoder, bytes]:
        layout, reader = self._layout, Reader(body)
        head = reader.take(1)[0]
        is_first, effort = bool(head & 16), head >> 5
        check(layout.is_codable and effort < len(EFFORTS))
        shape = Shape(*(reader.number() for _ in range(4)))
        count, others = shape.rows * shape.columns, shape.rows * shape.gap + shape.tail
        check(0 < count <= _MOST_POINTS)
        admit(count * layout.point_step + others)
        part = Reader(reader.take(reader.number()))
        rest = decompress_bytes(part, lambda size: check(size == others))
        if is_first:
            coder = PointCoder(layout, EFFORTS[effort])
        if coder is None:
            raise InputError(_NEEDS_ANOTHER)
        points = coder.decode(reader, count, _width(shape))
        check(not reader.rest())
        return coder, data_of(points, rest, shape)


def _quick_size(data: bytes) -> int:
    """Return about how many bytes a fast compressor takes, from a part of the data."""
    part = data[len(data) // 2 :][:_SAMPLE]
    return len(compressed(part, _QUICKLY)) * len(data) // max(len(part), 1)


def _width(shape: Shape) -> int:
    return shape.columns if shape.rows > 1 else 0
