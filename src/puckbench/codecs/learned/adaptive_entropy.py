"""Entropy coding of a latent value by value: what the network expects, mixed with contexts.

The network's tables take each value for itself. But the latent of a surface is much like that of
the surface beside it, and which of a voxel's neighbours are occupied, which is known before, says
how the surface lies: adaptive contexts of both learn that from the cloud itself. Each value becomes
a few bits: zero or not, the sign, one more or not. All arithmetic is on integers, so that every
machine decodes the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import (
    SLOWEST,
    BitCoder,
    bit_reader,
    bit_writer,
    code_gamma,
    read_to_its_end,
    written,
)
from puckbench.codecs.common.context_mixing import Habits, Mixer, code_mixed, mixer
from puckbench.codecs.learned.entropy_bottleneck import Table
from puckbench.codecs.learned.sparse.voxels import FACES, OFFSETS
from puckbench.codecs.learned.sparse.voxels import Table as Neighbours
from puckbench.core.compiling import compiled_in_place
from puckbench.core.errors import InputError

Integers = NDArray[np.int32]
Ints = NDArray[np.int64]
_UNARY = 20
"""Magnitudes up to here are told one by one."""
_MOST = _UNARY + 2**16 - 1
_NODES = 12
"""Bits of a value: zero, sign, magnitudes 1 to 4 and beyond, of either sign."""
_SIZES = (16 * 8, 20 * 5, 15 * 8, 4096, 64 * 6, 256 * 6, 64 * 8)
"""Contexts of seven kinds: see `_find_contexts`."""
_HABITS = Habits(estimate=0.4, context=0.15, pace=20, memory=SLOWEST)
_MOST_BYTES = 80
"""That a value takes: so many bits are coded for it, each at most log2(65,536 / 32) bits."""


class _Tables(NamedTuple):
    """The tables one after the other, without the escapes.

    below: sums of the frequencies before each integer. first: where in them a table's begin; its
    integers count from `lowest`. number, centre: of `Expected`.
    """

    lowest: Ints
    first: Ints
    below: Ints
    number: Integers
    centre: Integers


class _Around(NamedTuple):
    """What is known around a voxel; arrays to work in.

    patterns: which neighbours there are at its faces, edges and corners, a bit each. rows, weights:
    of those that were coded before, faces first, and how much they say. counts: how many these are,
    and how many of them are at faces. contexts: of a value, of each kind.
    """

    patterns: Ints
    rows: Ints
    weights: Ints
    counts: Ints
    contexts: Ints


class Expected(NamedTuple):
    """What is expected of values (n, channels): the table of each, and where its zero is.

    tables: those in use. number, centre: (n, channels), which of them, and the value that its zero
    stands for.
    """

    tables: tuple[Table, ...]
    number: NDArray[np.integer[Any]]
    centre: NDArray[np.integer[Any]]


def everywhere(tables: tuple[Table, ...], count: int) -> Expected:
    """A table for each channel, at all places."""
    number = np.tile(np.arange(len(tables), dtype=np.int32), (count, 1))
    return Expected(tables, number, np.zeros_like(number))


def encode_in_context(latent: Integers, neighbours: Neighbours, expected: Expected) -> bytes:
    """Code integers (n, channels) at voxels in order, with their neighbours (27, n).

    Values beyond 16 bits are clipped.
    """
    values = np.clip(latent, -_MOST, _MOST).astype(np.int64)
    bits = bit_writer(_MOST_BYTES * values.size + 16)
    _code(bits, values, neighbours, expected)
    return written(bits)


def decode_in_context(data: bytes, neighbours: Neighbours, expected: Expected) -> Integers:
    """Integers (n, channels) of `encode_in_context`; InputError when the data are damaged."""
    values = np.zeros(expected.number.shape, np.int64)
    bits = bit_reader(data)
    _code(bits, values, neighbours, expected)
    if not read_to_its_end(bits):
        raise InputError("the stream is damaged (features)")
    return values.astype(np.int32)


def _code(bits: BitCoder, values: Ints, neighbours: Neighbours, expected: Expected) -> None:
    kinds = _NODES * values.shape[1]
    starts = np.cumsum((0, *(kinds * size for size in _SIZES)))
    mixed = mixer(bits, int(starts[-1]), len(_SIZES), kinds, 1, _HABITS)
    around = _Around(*(np.zeros(n, np.int64) for n in (3, OFFSETS, OFFSETS, 2, len(_SIZES))))
    _code_values(mixed, values, neighbours, _joined(expected), around, starts)


def _joined(expected: Expected) -> _Tables:
    sums = [np.cumsum((0, *table.frequencies[:-1]), dtype=np.int64) for table in expected.tables]
    lowest = np.array([table.lowest for table in expected.tables], np.int64)
    first = np.cumsum((0, *map(len, sums)))
    number, centre = (np.ascontiguousarray(a, np.int32) for a in expected[1:])
    return _Tables(lowest, first, np.concatenate(sums), number, centre)


@compiled_in_place
def _code_values(
    mixer: Mixer, values: Ints, neighbours: Neighbours, tables: _Tables, around: _Around,
    starts: Ints,
) -> None:  # fmt: skip
    for row in range(len(values)):
        _look_around(around, neighbours, row)
        for channel in range(values.shape[1]):
            _find_contexts(around, values, row, channel)
            values[row, channel] = _code_value(
                mixer, tables, around, starts, row, channel, values[row, channel]
            )


@compiled_in_place
def _look_around(around: _Around, neighbours: Neighbours, row: int) -> None:
    known = 0
    for shell in range(3):
        pattern = 0
        for place in range((6, 12, 8)[shell]):
            offset = _offset(shell, place)
            other = neighbours[offset, row]
            pattern |= (other >= 0) << place
            if 0 <= other < row:
                around.rows[known] = other
                around.weights[known] = (36, 9, 4)[shell]
                known += 1
        around.patterns[shell] = pattern
        if shell == 0:
            around.counts[1] = known
    around.counts[0] = known


@compiled_in_place
def _offset(shell: int, place: int) -> int:
    """The offset of a neighbour at a face, an edge or a corner."""
    if shell == 0:
        return FACES[place]
    if shell == 1:
        return (1, 3, 5, 7, 9, 11, 15, 17, 19, 21, 23, 25)[place]
    return (0, 2, 6, 8, 18, 20, 24, 26)[place]


@compiled_in_place
def _find_contexts(around: _Around, values: Ints, row: int, channel: int) -> None:
    """The contexts of a value, but for the kind of the bit.

    In their order: mean magnitude of the neighbours coded before, and their number; mean of those
    at faces, and the largest magnitude; the two channels before, and the magnitudes of all before;
    which edges have neighbours; which faces, and the neighbours' mean; which corners, and that;
    which faces, and the magnitudes of the channels before.
    """
    mean, face, spread, largest = _neighbours_say(around, values, channel)
    before, last, second = 0, 0, 0
    for other in range(channel):
        before = min(before + abs(values[row, other]), 7)
    if channel >= 1:
        last = min(max(values[row, channel - 1], -2), 2) + 2
    if channel >= 2:
        second = min(max(values[row, channel - 2], -1), 1) + 1
    found, patterns = around.contexts, around.patterns
    found[0] = spread * 8 + min(around.counts[0], 7)
    found[1] = face * 5 + largest
    found[2] = (last * 3 + second) * 8 + before
    found[3] = patterns[1]
    found[4] = patterns[0] * 6 + mean
    found[5] = patterns[2] * 6 + mean
    found[6] = patterns[0] * 8 + before


@compiled_in_place
def _neighbours_say(around: _Around, values: Ints, channel: int) -> tuple[int, int, int, int]:
    """Mean, mean at faces, mean magnitude and largest magnitude of the neighbours before."""
    total, face, magnitude, weight, largest = 0, 0, 0, 0, 0
    for place in range(around.counts[0]):
        value, share = values[around.rows[place], channel], around.weights[place]
        total += share * value
        magnitude += share * abs(value)
        weight += share
        largest = max(largest, abs(value))
        if place < around.counts[1]:
            face += value
    mean = _rounded(3 * total, 2 * weight, 2, 5)
    nearest = _rounded(2 * face, around.counts[1], 9, 19)
    spread = _rounded(4 * magnitude, weight, 15, 15) - 15
    return mean, nearest, spread, min(largest, 4)


@compiled_in_place
def _rounded(total: int, count: int, most: int, unknown: int) -> int:
    """The quotient, rounded, from 0 for `-most` on; `unknown` without a count."""
    if count == 0:
        return unknown
    return min(max((2 * total + count) // (2 * count), -most), most) + most


@compiled_in_place
def _code_value(
    mixer: Mixer, tables: _Tables, around: _Around, starts: Ints, row: int, channel: int, value: int
) -> int:
    """Code a value: whether it is zero, its sign, whether its magnitude is 1, 2, and so on."""
    kind = _NODES * channel
    zero = _mass(tables, row, channel, 0, 0)
    above, below = _mass(tables, row, channel, 1, _MOST), _mass(tables, row, channel, -_MOST, -1)
    if _code_node(mixer, around, starts, kind, zero, above + below, value == 0) == 1:
        return 0
    sign = 2 * _code_node(mixer, around, starts, kind + 1, above, below, value > 0) - 1
    rest = above if sign == 1 else below
    for size in range(1, _UNARY + 1):
        this = _mass(tables, row, channel, sign * size, sign * size)
        rest -= this
        node = kind + 1 + min(size, 5) + (5 if sign == 1 else 0)
        if _code_node(mixer, around, starts, node, this, rest, abs(value) == size) == 1:
            return sign * size
    return sign * (_UNARY + code_gamma(mixer.bits, abs(value) - _UNARY))


@compiled_in_place
def _mass(tables: _Tables, row: int, channel: int, first: int, last: int) -> int:
    """Frequency of the values from `first` to `last`."""
    number = tables.number[row, channel]
    start, end = tables.first[number], tables.first[number + 1] - 1
    zero = start - tables.lowest[number] - tables.centre[row, channel]
    low = min(max(zero + first, start), end)
    high = min(max(zero + last + 1, start), end)
    return int(tables.below[high] - tables.below[low])


@compiled_in_place
def _code_node(
    mixer: Mixer, around: _Around, starts: Ints, kind: int, yes: int, no: int, bit: int
) -> int:
    """Code a bit for which the tables have these frequencies."""
    for place in range(len(mixer.at)):
        mixer.at[place] = starts[place] + kind * _SIZES[place] + around.contexts[place]
    share = min((yes << 12) // (yes + no), 4095) if yes + no > 0 else 2048
    mixer.rows[0] = kind
    return code_mixed(mixer, int(bit), mixer.stretch[share])
