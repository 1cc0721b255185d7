"""Context-mixing coder of the corrections of points, in steps along x, y and z.

Magnitudes depend on the distance, which shows in the corrections of the points before; and the
directions of errors on the azimuth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.inter_lpcm.turn import STEPS_PER_TURN
from pointkit.coding.binary_coder import (
    MAX_MEMORY,
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
MAX_CORRECTION = _MAX_UNARY + 2**16 - 1
"""Largest magnitude of a correction, in steps."""
_NODES = 2 + _MAX_UNARY
"""Binary decisions of a value: zero, sign, magnitude."""
_AXES, _SECTORS, _BEFORE = 3, 16, 8
_SIZES = (_AXES * 16 * 16, _AXES * 64, _AXES * _SECTORS * 8, _AXES * _SECTORS * 81, _AXES * 15 * 7)
"""Numbers of contexts of the five kinds, see `_find_contexts`."""
_STARTS = np.cumsum((0, *_SIZES)) * _NODES
_MOST_BYTES = 96
"""Maximum bytes of a value: decisions of at most 11 bits, and 33 bits of gamma code."""


def encode_corrections(corrections: Ints, azimuth: Ints) -> bytes:
    """Encode corrections (n, 3) of points with azimuths (n,) in steps, and return the bytes.

    Magnitudes must not exceed `MAX_CORRECTION`.
    """
    bits = bit_writer(_MOST_BYTES * corrections.size + 64)
    _code_all(_mixer(bits), corrections, azimuth, _STARTS)
    return written(bits)


def decode_corrections(data: bytes, azimuth: Ints) -> Ints:
    """Return the corrections (n, 3) of points with azimuths (n,) in steps.

    Raises InputError if the data are damaged.
    """
    corrections = np.zeros((len(azimuth), _AXES), np.int64)
    bits = bit_reader(data)
    _code_all(_mixer(bits), corrections, azimuth, _STARTS)
    if not read_to_its_end(bits):
        raise InputError("the stream is damaged (corrections)")
    return corrections


def _mixer(bits: object) -> Mixer:
    options = MixerOptions(
        contexts=len(_SIZES),
        counters=int(_STARTS[-1]),
        rows=_AXES * _NODES,
        weights=(0.3,) * len(_SIZES),
        memory=MAX_MEMORY,
    )
    return new_mixer(bits, options)  # type: ignore[arg-type]


@compiled_in_place
def _code_all(mixer: Mixer, values: Ints, azimuth: Ints, starts: Ints) -> None:
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
    """Compute the contexts of a value from those coded before it. They depend on:

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
