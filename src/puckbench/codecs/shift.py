"""Shift of clouds that are far from the origin, for codecs in single precision.

Coordinates are far from the origin in UTM, for example. Shifts are integers and thus exact. The
stream of a shifted cloud is

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
    """A stream without the header of a shift, and the shift."""

    stream: bytes  # of the codec
    shift: Floats | None  # (3,), to be added to the decoded points


def shift_of(points: Floats, step: float | None = None) -> Floats | None:
    """Return the shift that brings a cloud near the origin.

    Parameters
    ----------
    points
        Points (n, 3).
    step
        Step of the grid to which points are rounded. A shift is then also needed if single
        precision does not resolve an eighth of the step.

    Returns
    -------
    numpy.ndarray or None
        Integers (3,) to subtract from the points, or None if no shift is needed.
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
    """Return a codec's stream after a header with the shift (3,)."""
    return MAGIC + b"".join(signed_128(int(axis)) for axis in shift) + stream


def unshifted(stream: bytes) -> Shifted:
    """Separate a codec's stream from the header with the shift, if there is one.

    Raises InputError if the header is damaged.
    """
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
    """Return points (m, 3) plus the shift (3,); raise InputError if a coordinate is not finite."""
    with np.errstate(over="ignore"):
        result: Floats = points + shift
    if not np.isfinite(result).all():
        raise InputError("the stream is damaged (its shift)")
    return result
