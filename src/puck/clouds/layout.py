"""Arrangement of the values of a PointCloud2 message, and its bytes as columns of integers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints
from pointkit.compiling import compiled_in_place
from puck.recordings.point_cloud2 import KINDS
from puck.records import check

Bytes = NDArray[np.uint8]
Values = NDArray[np.unsignedinteger[Any]]

SIZES = {code: np.dtype(kind).itemsize for code, kind in KINDS.items()}
"""Number of bytes of a value, by the code of its data type in a message."""
FLOAT32, FLOAT64 = 7, 8
_SIGNED = (1, 3, 5)
_MOST_FIELDS, _MOST_NAME, _MOST_COLUMNS = 1 << 12, 1 << 12, 1 << 12
_MOST_STEP = 1 << 20


@dataclass(frozen=True)
class CloudField:
    """Field of each point: name, offset in bytes, code of its data type, and number of values."""

    name: str
    offset: int
    datatype: int
    count: int


class Column(NamedTuple):
    """One value of each point.

    It has a name (empty for bytes between fields), a place and a size in bytes, and the code of its
    data type.
    """

    name: str
    offset: int
    size: int
    datatype: int


@dataclass(frozen=True)
class CloudLayout:
    """What the headers of a topic's PointCloud2 messages say about the bytes of a point.

    Parameters
    ----------
    fields
        The fields, in the order of the message. They may overlap, or not fit in a point.
    point_step
        Number of bytes from one point to the next.
    is_big_endian
        Whether values have their most significant byte first.
    """

    fields: tuple[CloudField, ...]
    point_step: int
    is_big_endian: bool

    def packed(self) -> bytes:
        """Return the layout as bytes, which `unpacked` reads."""
        parts = [base_128(self.point_step << 1 | self.is_big_endian), base_128(len(self.fields))]
        for one in self.fields:
            text = one.name.encode("utf-8", "surrogateescape")
            numbers = one.offset, one.datatype, one.count
            parts += [base_128(len(text)), text, *map(base_128, numbers)]
        return b"".join(parts)

    @classmethod
    def unpacked(cls, data: bytes) -> Self:
        """Return the layout that `packed` wrote; raise InputError if the bytes are damaged."""
        reader = Reader(data)
        step, count = reader.number(), reader.number()
        check(count <= _MOST_FIELDS)
        fields = []
        for _ in range(count):
            size = reader.number()
            check(size <= _MOST_NAME)
            name = reader.take(size).decode("utf-8", "surrogateescape")
            fields.append(CloudField(name, reader.number(), reader.number(), reader.number()))
        check(not reader.rest())
        return cls(tuple(fields), step >> 1, bool(step & 1))

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The columns of a point, which cover each of its bytes once.

        A field that overlaps an earlier one, does not fit in the point, or has an unknown type is
        left to columns of single bytes.
        """
        if not 0 < self.point_step <= _MOST_STEP:
            return ()
        free, found = np.ones(self.point_step, bool), []
        for one in self.fields:
            size = SIZES.get(one.datatype, 0)
            places = range(one.offset, one.offset + size * one.count, size or 1)
            if places and places.stop <= self.point_step and free[places.start : places.stop].all():
                free[places.start : places.stop] = False
                found += [Column(one.name, place, size, one.datatype) for place in places]
        found += [Column("", int(place), 1, 2) for place in np.flatnonzero(free)]
        return tuple(sorted(found, key=lambda column: column.offset))

    @property
    def is_codable(self) -> bool:
        """Whether points have columns, and not too many of them."""
        return 0 < len(self.columns) <= _MOST_COLUMNS

    def values(self, points: Bytes, column: Column) -> Values:
        """Return a column of points (n, point_step) as unsigned integers (n,) in their order.

        Signed and floating-point numbers become unsigned integers that are sorted like them.
        """
        order = ">" if self.is_big_endian else "<"
        part = np.ascontiguousarray(points[:, column.offset : column.offset + column.size])
        raw = part.view(f"{order}u{column.size}")[:, 0].astype(f"u{column.size}")
        return to_sorted(raw, column.datatype)

    def all_values(self, points: Bytes) -> list[Ints]:
        """Return all columns of points (n, point_step), each as `values` does, in 64 bits.

        Constant columns are read-only and take no memory.
        """
        changes, result = np.zeros(self.point_step, np.uint8), []
        _mark_changes(points, changes)
        for column in self.columns:
            is_constant = not changes[column.offset : column.offset + column.size].any()
            some = self.values(points[:1] if is_constant else points, column).astype(np.int64)
            result.append(np.broadcast_to(some, len(points)) if is_constant else some)
        return result

    def put(self, points: Bytes, column: Column, values: Values) -> None:
        """Write a column, which `values` returned, to points (n, point_step)."""
        order = ">" if self.is_big_endian else "<"
        raw = from_sorted(values, column.datatype).astype(f"{order}u{column.size}")
        part = raw.reshape(-1, 1).view(np.uint8)
        points[:, column.offset : column.offset + column.size] = part

    def points_with(self, values: list[Ints]) -> Bytes:
        """Return the bytes of points, (n, point_step), of which `all_values` returned `values`."""
        points = np.empty((len(values[0]), self.point_step), np.uint8)
        pairs = list(zip(self.columns, values, strict=True))
        for column, numbers in pairs:
            self.put(points[:1], column, numbers[:1].astype(f"u{column.size}"))
        points[1:] = points[:1]
        for column, numbers in pairs:
            if any(numbers.strides):
                self.put(points, column, numbers.astype(f"u{column.size}"))
        return points


@compiled_in_place
def _mark_changes(points: Bytes, changes: Bytes) -> None:
    """Make `changes` (point_step,) nonzero for each byte of a point that differs between points."""
    for i in range(len(points)):
        for k in range(len(changes)):
            changes[k] |= points[i, k] ^ points[0, k]


def to_sorted(raw: Values, datatype: int) -> Values:
    """Return the bits of numbers (n,) as unsigned integers that are sorted like the numbers."""
    top = raw.dtype.type(1 << 8 * raw.itemsize - 1)
    if datatype in _SIGNED:
        return raw ^ top
    if datatype in (FLOAT32, FLOAT64):
        return np.where(raw & top, ~raw, raw | top)
    return raw


def from_sorted(values: Values, datatype: int) -> Values:
    """Undo `to_sorted`."""
    top = values.dtype.type(1 << 8 * values.itemsize - 1)
    if datatype in _SIGNED:
        return values ^ top
    if datatype in (FLOAT32, FLOAT64):
        return np.where(values & top, values ^ top, ~values)
    return values


class Shape(NamedTuple):
    """Where the points are in the bytes of a message: numbers of points and of rows, and the bytes
    after each row, and after all rows.
    """

    rows: int
    columns: int
    gap: int
    tail: int


def shape_of(layout: CloudLayout, size: int, width: int, height: int, row_step: int) -> Shape:
    """Return where the points are in a message of `size` bytes.

    If the message's own numbers contradict each other, all its bytes are one row.
    """
    step = layout.point_step
    if height > 0 and width > 0 and width * step <= row_step and height * row_step <= size:
        return Shape(height, width, row_step - width * step, size - height * row_step)
    if height == 1 and 0 < width * step <= size:
        return Shape(1, width, 0, size - width * step)
    return Shape(1, size // step, 0, size % step) if step else Shape(1, 0, 0, size)


def points_of(data: Bytes, step: int, shape: Shape) -> tuple[Bytes, bytes]:
    """Return the points (n, step) of a message, and all other bytes."""
    length = shape.columns * step
    lines = data[: len(data) - shape.tail].reshape(shape.rows, length + shape.gap)
    points = np.ascontiguousarray(lines[:, :length]).reshape(-1, step)
    return points, lines[:, length:].tobytes() + data[len(data) - shape.tail :].tobytes()


def data_of(points: Bytes, rest: bytes, shape: Shape) -> bytes:
    """Undo `points_of`."""
    if not rest:
        return points.tobytes()
    others = np.frombuffer(rest, np.uint8)
    gaps = others[: len(others) - shape.tail].reshape(shape.rows, shape.gap)
    lines = np.concatenate([points.reshape(shape.rows, -1), gaps], axis=1)
    return lines.tobytes() + others[len(others) - shape.tail :].tobytes()
