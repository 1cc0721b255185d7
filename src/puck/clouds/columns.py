"""Choice of how each column of a cloud's values is coded, and conversion of values to integers."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints
from puck.clouds.layout import FLOAT32, Bytes, Column, from_sorted, to_sorted
from puck.gaps import compress_bytes, decompress_bytes
from puck.records import check

RING_NAMES = ("ring", "channel", "laser_id", "line", "laser")
_TIME_NAMES = ("t", "time", "timestamp", "time_stamp", "offset_time", "time_offset")
_SCALES = (0, 1, 10, 100, 1000, 10000, 255, 256, 1000000)
"""Factors by which floats become integers, by their index in the stream; 0 for the floats' bits."""
_MOST_WHOLE = 1e6
_MOST_ODD = 0.02
"""Share of floats that may not be integers in a column's unit; they are listed."""
_SAMPLE = 200
"""Number of values that are tried first."""
_MOST_VALUE = 1 << 23
_MOST_SPAN = 1 << 62
_KEPT_BITS = 6
"""Modelled bits of a typical difference between successive values; lower bits are noise."""
_WORD = 1 << 64


class Way(IntEnum):
    """How a column is coded: one value, a series, noisy values, from rays, from ranges, or as
    compressed bytes.
    """

    CONSTANT, SERIES, VALUES, RAY, RANGE, STORED = range(6)


class ColumnPlan(NamedTuple):
    """How a column is coded.

    `scale` is the index of a factor that makes floats integers; `shift` is the number of low bits
    that are stored uncoded; `lowest` is the constant, or the value that is subtracted, modulo 2^64;
    `farthest` is the largest coded value or, for `Way.RANGE`, the factor of the ranges.
    """

    way: Way
    scale: int = 0
    shift: int = 0
    lowest: int = 0
    farthest: int = 0

    def packed(self) -> bytes:
        """Return the bytes that `unpacked` reads."""
        numbers = base_128(self.lowest) + base_128(self.farthest)
        return bytes([self.way, self.scale, self.shift]) + numbers

    @classmethod
    def unpacked(cls, reader: Reader, column: Column) -> ColumnPlan:
        """Read what `packed` wrote; raise InputError if it is damaged."""
        way, scale, shift = reader.take(3)
        check(way in list(Way) and scale < len(_SCALES) and shift < 8 * column.size)
        check(scale == 0 or column.datatype == FLOAT32)
        lowest, farthest = reader.number(10), reader.number()
        check(lowest < _WORD and farthest <= _MOST_VALUE)
        return cls(Way(way), scale, shift, lowest, farthest)

    @property
    def start(self) -> np.int64:
        """The number `lowest` as a signed integer."""
        return np.uint64(self.lowest).astype(np.int64)


def singles(values: Ints) -> NDArray[np.float32]:
    """Return the floats whose sorted bits are given."""
    return from_sorted(values.astype(np.uint32), FLOAT32).view(np.float32)


def sorted_bits(floats: NDArray[np.float32]) -> Ints:
    """Return the sorted bits of floats."""
    return to_sorted(np.ascontiguousarray(floats).view(np.uint32), FLOAT32).astype(np.int64)


def plan_column(column: Column, values: Ints, width: int) -> ColumnPlan:
    """Return how to code a column.

    Parameters
    ----------
    column
        What the layout says about the column.
    values
        The values (n,) as sorted integers, modulo 2^64.
    width
        Number of points in a row of an organised cloud, otherwise 0.
    """
    if values.strides == (0,) or (values == values[0]).all():
        return ColumnPlan(Way.CONSTANT, lowest=int(values[0]) % _WORD)
    if column.name.lower() in RING_NAMES + _TIME_NAMES or _is_regular(values, width):
        return ColumnPlan(Way.SERIES)
    scale, whole = 0, values
    if column.datatype == FLOAT32:
        scale, whole = _scaled(singles(values), values)
    lowest, span = int(whole.min()), int(whole.max()) - int(whole.min())
    shift = max(int(np.median(np.abs(np.diff(whole)))).bit_length() - _KEPT_BITS, 0)
    if span >= _MOST_SPAN or span >> shift >= _MOST_VALUE:
        return ColumnPlan(Way.SERIES)
    return ColumnPlan(Way.VALUES, scale, shift, lowest % _WORD, (span >> shift) + 1)


def plan_ranges(values: Ints, there: NDArray[np.intp], ranges: Ints) -> ColumnPlan | None:
    """Return the plan of a column (n,) that follows from the ranges (m,), or None.

    The argument `there` (m,) has the indices of the points with a range.
    """
    few = slice(0, _SAMPLE)
    first, last = int(np.argmin(ranges[few])), int(np.argmax(ranges[few]))
    apart, start = int(ranges[last] - ranges[first]), int(values[there[first]])
    factor = (int(values[there[last]]) - start) // apart if apart else 0
    lowest = start - factor * int(ranges[first])
    if 0 < factor <= _MOST_VALUE:
        for some in few, slice(None):
            if (values[there[some]] != ranges[some] * factor + lowest).any():
                return None
        return ColumnPlan(Way.RANGE, lowest=lowest % _WORD, farthest=factor)
    return None


def _is_regular(values: Ints, width: int) -> bool:
    """Return whether most values follow exactly from earlier ones."""
    steps = np.diff(values)
    hits = [np.count_nonzero(steps == 0), np.count_nonzero(np.diff(steps) == 0)]
    if 0 < width < len(values):
        hits.append(np.count_nonzero(values[width:] == values[:-width]))
    return 2 * int(max(hits)) > len(values)


def _scaled(floats: NDArray[np.float32], bits: Ints) -> tuple[int, Ints]:
    """Return the index of the scale by which floats are integers, and these; 0 and the bits."""
    few = slice(0, _SAMPLE)
    for k in range(1, len(_SCALES)):
        _, odd = _whole(floats[few], bits[few], k)
        if 2 * np.count_nonzero(odd) <= len(odd):
            whole, odd = _whole(floats, bits, k)
            if np.count_nonzero(odd) <= _MOST_ODD * len(bits):
                return k, whole
    return 0, bits


def _whole(floats: NDArray[np.float32], bits: Ints, scale: int) -> tuple[Ints, NDArray[np.bool_]]:
    """Return floats as integers, and which floats are not restored from them."""
    is_usual = np.abs(floats) < _MOST_WHOLE
    whole = np.rint(np.where(is_usual, floats, 0).astype(np.float64) * _SCALES[scale])
    numbers = whole.astype(np.int64)
    return numbers, _scaled_back(numbers, scale) != bits


def _scaled_back(whole: Ints, scale: int) -> Ints:
    return sorted_bits((whole / _SCALES[scale]).astype(np.float32))


class SplitColumn(NamedTuple):
    """A column as numbers (n,) from 1 that are modelled, and two parts that are stored: their low
    bits, and a list of numbers that are not integers in the column's unit.
    """

    numbers: Ints
    low: bytes
    listed: bytes


def split_column(plan: ColumnPlan, values: Ints) -> SplitColumn:
    """Return the parts of a column (n,) of sorted integers."""
    whole, listed = values, b""
    if plan.scale:
        whole, odd = _whole(singles(values), values, plan.scale)
        listed = _listed(values, odd)
    above = whole - plan.start
    return SplitColumn((above >> plan.shift) + 1, _bit_planes(above, plan.shift), listed)


def join_column(plan: ColumnPlan, parts: SplitColumn) -> Ints:
    """Undo `split_column`; raise InputError if the stored parts are damaged."""
    above = parts.numbers - 1 << plan.shift
    _add_bit_planes(above, parts.low, plan.shift)
    values: Ints = above + plan.start
    if plan.scale:
        values = _scaled_back(values, plan.scale)
        _write_listed(values, parts.listed)
    return values


def _bit_planes(numbers: Ints, width: int) -> bytes:
    planes = [np.packbits((numbers >> k & 1).astype(np.uint8)) for k in range(width)]
    return b"".join(plane.tobytes() for plane in planes)


def _add_bit_planes(numbers: Ints, packed: bytes, width: int) -> None:
    size = -(-len(numbers) // 8)
    check(len(packed) == size * width)
    planes: Bytes = np.frombuffer(packed, np.uint8).reshape(width, size)
    for k in range(width):
        numbers += np.unpackbits(planes[k], count=len(numbers)).astype(np.int64) << k


def _listed(bits: Ints, odd: NDArray[np.bool_]) -> bytes:
    """Return the places and values of odd numbers, compressed, or no bytes if there are none."""
    places = np.flatnonzero(odd)
    pairs = np.stack([np.diff(places, prepend=0), bits[places]]).astype("<u4")
    return compress_bytes(pairs.tobytes()) if len(places) else b""


def _write_listed(bits: Ints, listed: bytes) -> None:
    """Write the numbers of `_listed` to their places."""
    if listed:
        most = 8 * len(bits)
        raw = decompress_bytes(Reader(listed), lambda size: check(size <= most and size % 8 == 0))
        steps, values = np.frombuffer(raw, "<u4").reshape(2, -1).astype(np.int64)
        places = np.cumsum(steps)
        check(not len(places) or int(places[-1]) < len(bits))
        bits[places] = values
