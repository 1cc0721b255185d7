"""Shift of clouds far from the origin (as in UTM coordinates) for codecs in single precision.

Shifts are integers and thus exact. The stream of a shifted cloud is

    4 bytes  "PBSH"
    the shift along each axis, a signed LEB128 number
    the stream of the codec
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.byte_io import Reader, signed_128, stream_bytes
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, bounds

MAGIC = b"PBSH"
_FAR = 64
"""A cloud is far away if its largest coordinate exceeds this multiple of its extent.

At this coordinate, adjacent single-precision numbers are over 2^-18 of the extent apart.
"""
_FINE = 1 << 20
"""A cloud on a grid is also far away if its largest coordinate exceeds this multiple of the grid's
step. Up to this multiple, adjacent single-precision numbers are at most 1/8 step apart."""
_LONGEST = 150
"""Maximum bytes of a shift along an axis; the integer part of any double needs fewer."""


class Shifted(NamedTuple):
    stream: bytes  # of the codec
    shift: Floats | None  # (3,), to be added to the decoded points


def shift_of(points: Floats, step: float | None = None) -> Floats | None:
    """Return the integers (3,) to subtract from points (n, 3), or None if no shift is needed.

    Points on a grid also need a shift if single precision does not resolve `step` / 8.
    """
    ends = bounds(points)
    with np.errstate(over="ignore"):
        extent, most = float(np.ptp(ends, axis=0).max()), float(np.abs(ends).max())
        near = most <= _FAR * extent
        if step is not None and most > 2 * extent:
            near &= most <= _FINE * step
    shift: Floats = np.floor(ends[0])
    return None if near or not shift.any() else shift


def shifted(stream: bytes, shift: Floats) -> bytes:
    return MAGIC + b"".join(signed_128(int(axis)) for axis in shift) + stream


def unshifted(stream: bytes) -> Shifted:
    """Separate the header from the codec's stream; raise InputError if the header is damaged."""
    stream = stream_bytes(stream)
    if not stream.startswith(MAGIC):
        return Shifted(stream, None)
    reader = Reader(stream[len(MAGIC) :])
    try:
        shift = np.array([float(reader.signed(_LONGEST)) for _ in range(3)])
    except OverflowError as error:
        raise InputError("the stream is damaged (its shift)") from error
    return Shifted(reader.rest(), shift)


def moved(points: Floats, shift: Floats) -> Floats:
    """Add the shift (3,) to points (m, 3); raise InputError if a result is not finite."""
    with np.errstate(over="ignore"):
        result: Floats = points + shift
    if not np.isfinite(result).all():
        raise InputError("the stream is damaged (its shift)")
    return result
