"""Context-mixing coders of elevations' symbols, and of the corrections of points.

The authors code both with DeepCABAC, whose contexts are the preceding value's sign and nothing
else. Here they also depend on magnitudes before, on the radius, and on the azimuth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.inter_lpcm.turn import STEPS_PER_TURN
from pointkit.coding.binary_coder import (
    MAX_MEMORY,
    BitCoder,
    bit_reader,
    bit_writer,
    code_gamma,
    exhausted,
    read_to_its_end,
    written,
)
from pointkit.coding.context_mixing import Mixer, MixerOptions, code_bit, new_mixer
from pointkit.compiling import compiled_in_place
from pointkit.errors import InputError

Ints = NDArray[np.int64]
_MAX_UNARY = 20
"""Magnitudes up to this value are coded in unary, larger ones in Elias gamma code."""
MAX_VALUE = _MAX_UNARY + 2**16 - 1
"""Largest magnitude of a value."""
_NODES = 2 + _MAX_UNARY
"""Binary decisions of a value: zero, sign, magnitude."""
_MOST_BYTES = 40
"""Maximum bytes of a value: decisions of at most 11 bits, and 33 bits of gamma code."""
_BEFORE = 8
_RADIUS_BITS, _LINES = 16, 64
_ELEVATION_SIZES = (9 * 5, 64, _RADIUS_BITS * 3, _LINES * 3, 17 * 3)
_ELEVATION_STARTS = np.cumsum((0, *_ELEVATION_SIZES))
_AXES, _SECTORS = 3, 16
_SIZES = (_AXES * 16 * 16, _AXES * 64, _AXES * _SECTORS * 8, _AXES * _SECTORS * 81, _AXES * 15 * 7)
"""Numbers of contexts of the five kinds of corrections, see `_find_contexts`."""
_STARTS = np.cumsum((0, *_SIZES)) * _NODES


class ElevationCoder:
    """Encodes or decodes symbols of elevations, several lines at once.

    Parameters
    ----------
    lines
        Number of lines.
    bits
        From `bit_writer` or `bit_reader`.
    """

    def __init__(self, lines: int, bits: BitCoder) -> None:
        self._bits = bits
        self._mixer = _new_mixer(bits, _ELEVATION_STARTS[-1] * _NODES, 1)
        self._before = np.zeros((lines, _BEFORE), np.int64)

    @classmethod
    def writer(cls, lines: int, symbols: int) -> ElevationCoder:
        """Return a coder that encodes at most `symbols` symbols."""
        return cls(lines, bit_writer(_MOST_BYTES * symbols + 64))

    @classmethod
    def reader(cls, lines: int, data: bytes) -> ElevationCoder:
        """Return a coder that decodes the bytes of `written`."""
        return cls(lines, bit_reader(data))

    def code(self, symbols: Ints, rows: Ints, radius: Ints) -> Ints:
        """Encode or decode the next symbol of each of some lines, and return the symbols (m,).

        A coder from `writer` encodes, one from `reader` decodes.

        Parameters
        ----------
        symbols
            Symbols (m,), which a decoder ignores.
        rows
            Numbers (m,) of the lines.
        radius
            Symbols (m,) of the radii of the same points.

        Raises
        ------
        InputError
            The stream that is decoded has ended.
        """
        if exhausted(self._bits):
            raise InputError("the stream is damaged (elevations)")
        before = self._before[rows]
        coded = symbols.copy()
        _code_with(self._mixer, coded, _elevation_contexts(before, rows, radius) * _NODES)
        self._before[rows, 1:] = before[:, :-1]
        self._before[rows, 0] = coded
        return coded

    def written(self) -> bytes:
        """Finish encoding, and return the bytes of the stream."""
        return written(self._bits)

    def check_end(self) -> None:
        """Raise InputError unless a decoder has read exactly the bytes that were written."""
        if not read_to_its_end(self._bits):
            raise InputError("the stream is damaged (elevations)")


def _elevation_contexts(before: Ints, rows: Ints, radius: Ints) -> Ints:
    """Return the contexts (m, 5) of symbols. They depend on:

    0. the two symbols before in the line
    1. the sum of the magnitudes of the eight symbols before
    2. the magnitude of the radius's symbol, and the sign of the symbol before
    3. the line, and the sign of the symbol before
    4. the radius's symbol, and the sign of the symbol before
    """
    sign = np.sign(before[:, 0]) + 1
    bits = np.ceil(np.log2(np.abs(radius) + 1)).astype(np.int64)
    numbers = (
        (np.clip(before[:, 0], -4, 4) + 4) * 5 + np.clip(before[:, 1], -2, 2) + 2,
        np.minimum(np.abs(before).sum(axis=1), 63),
        np.minimum(bits, _RADIUS_BITS - 1) * 3 + sign,
        np.minimum(rows, _LINES - 1) * 3 + sign,
        (np.clip(radius, -8, 8) + 8) * 3 + sign,
    )
    contexts: Ints = np.stack(numbers, axis=1) + _ELEVATION_STARTS[:-1]
    return contexts


def encode_corrections(corrections: Ints, azimuth: Ints) -> bytes:
    """Encode corrections (n, 3) of points with azimuths (n,) in steps, and return the bytes.

    Magnitudes must not exceed `MAX_VALUE`.
    """
    bits = bit_writer(_MOST_BYTES * corrections.size + 64)
    _code_corrections(_new_mixer(bits, _STARTS[-1], _AXES), corrections, azimuth, _STARTS)
    return written(bits)


def decode_corrections(data: bytes, azimuth: Ints) -> Ints:
    """Return the corrections (n, 3) of points with azimuths (n,) in steps.

    Raises InputError if the data are damaged.
    """
    corrections = np.zeros((len(azimuth), _AXES), np.int64)
    bits = bit_reader(data)
    _code_corrections(_new_mixer(bits, _STARTS[-1], _AXES), corrections, azimuth, _STARTS)
    if not read_to_its_end(bits):
        raise InputError("the stream is damaged (corrections)")
    return corrections


def _new_mixer(bits: BitCoder, counters: int, kinds: int) -> Mixer:
    options = MixerOptions(
        contexts=len(_SIZES),
        counters=int(counters),
        rows=kinds * _NODES,
        weights=(0.3,) * len(_SIZES),
        memory=MAX_MEMORY,
    )
    return new_mixer(bits, options)


@compiled_in_place
def _code_with(mixer: Mixer, values: Ints, contexts: Ints) -> None:
    for row in range(len(values)):
        for k in range(contexts.shape[1]):
            mixer.contexts[k] = contexts[row, k]
        mixer.rows[0] = 0
        values[row] = _code_value(mixer, values[row])


@compiled_in_place
def _code_corrections(mixer: Mixer, values: Ints, azimuth: Ints, starts: Ints) -> None:
    for row in range(len(values)):
        if exhausted(mixer.bits):
            return
        sector = (azimuth[row] * _SECTORS // STEPS_PER_TURN) % _SECTORS
        for axis in range(_AXES):
            _find_contexts(mixer, values, starts, row, axis, sector)
            mixer.rows[0] = axis * _NODES
            values[row, axis] = _code_value(mixer, values[row, axis])


@compiled_in_place
def _find_contexts(
    mixer: Mixer, values: Ints, starts: Ints, row: int, axis: int, sector: int
) -> None:
    """Compute the contexts of a correction from those coded before it. They depend on:

    0. the magnitudes along the axis of the two points before
    1. the sum of the magnitudes along the axis of the eight points before
    2. the azimuth, and the magnitude along the axis of the point before
    3. the azimuth, and the values of the point along the axes before
    4. the values along the axis of the two points before
    """
    one = values[row - 1, axis] if row > 0 else 0
    two = values[row - 2, axis] if row > 1 else 0
    total = 0
    for k in range(max(row - _BEFORE, 0), row):
        total += abs(values[k, axis])
    first = min(max(values[row, 0], -4), 4) + 4 if axis > 0 else 4
    second = min(max(values[row, 1], -4), 4) + 4 if axis > 1 else 4
    place = axis * _SECTORS + sector
    numbers = (
        (axis * 16 + min(abs(one), 15)) * 16 + min(abs(two), 15),
        axis * 64 + min(total, 63),
        place * 8 + min(abs(one), 7),
        place * 81 + first * 9 + second,
        (axis * 15 + min(max(one, -7), 7) + 7) * 7 + min(max(two, -3), 3) + 3,
    )
    for k in range(len(numbers)):
        mixer.contexts[k] = starts[k] + numbers[k] * _NODES


@compiled_in_place
def _code_value(mixer: Mixer, value: int) -> int:
    if code_bit(mixer, int(value == 0), 0, 0) == 1:
        return 0
    sign = 2 * code_bit(mixer, int(value > 0), 1, 1) - 1
    magnitude = abs(value)
    for size in range(1, _MAX_UNARY + 1):
        if code_bit(mixer, int(magnitude == size), 1 + size, 1 + size) == 1:
            return sign * size
    return sign * (_MAX_UNARY + code_gamma(mixer.bits, magnitude - _MAX_UNARY))
