"""Lossless coding of the data of successive PointCloud2 messages of one topic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pointkit.coding.byte_io import Reader, base_128
from puck.clouds.layout import CloudField, CloudLayout, Shape, data_of, points_of, shape_of
from puck.gaps import compress_bytes, decompress_bytes
from puck.options import CodingOptions
from puck.records import check

__all__ = ["CloudDecoder", "CloudEncoder", "CloudField", "CloudLayout"]

_RAW, _COLUMNS = range(2)


class CloudEncoder:
    """Encoder of the data of successive messages with one layout."""

    def __init__(self, layout: CloudLayout, options: CodingOptions) -> None:
        self._layout, self._options = layout, options

    def encode(
        self, data: bytes, width: int, height: int, row_step: int, *, is_key: bool
    ) -> bytes:
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
        if not layout.is_codable:
            return bytes([_RAW]) + compress_bytes(data)
        shape = shape_of(layout, len(data), width, height, row_step)
        points, rest = points_of(np.frombuffer(data, np.uint8), layout.point_step, shape)
        parts = []
        for column in layout.columns:
            values = layout.values(points, column)
            steps = np.diff(values, prepend=values.dtype.type(0))
            planes = steps.view(np.uint8).reshape(-1, column.size).T
            parts.append(compress_bytes(planes.tobytes()))
        head = bytes([_COLUMNS]) + b"".join(map(base_128, shape))
        parts.append(compress_bytes(rest))
        return head + b"".join(base_128(len(part)) + part for part in parts)


class CloudDecoder:
    """Decoder of the bytes of a `CloudEncoder`, in the same order, starting with a key message."""

    def __init__(self, layout: CloudLayout) -> None:
        self._layout = layout

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
        layout, reader = self._layout, Reader(body)
        mode = reader.take(1)[0]
        if mode == _RAW:
            return decompress_bytes(reader, admit)
        check(mode == _COLUMNS and layout.is_codable)
        shape = Shape(*(reader.number() for _ in range(4)))
        count, beside = shape.rows * shape.columns, shape.rows * shape.gap + shape.tail
        admit(count * layout.point_step + beside)
        points = np.zeros((count, layout.point_step), np.uint8)
        for column in layout.columns:
            raw = _part(reader, count * column.size)
            steps = np.frombuffer(raw, np.uint8).reshape(column.size, -1).T.copy()
            values = np.cumsum(steps.view(f"<u{column.size}")[:, 0], dtype=f"u{column.size}")
            layout.put(points, column, values)
        rest = _part(reader, beside)
        check(not reader.rest())
        return data_of(points, rest, shape)


def _part(reader: Reader, size: int) -> bytes:
    part = Reader(reader.take(reader.number()))
    raw = decompress_bytes(part, lambda announced: check(announced == size))
    return raw
