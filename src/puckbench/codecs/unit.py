"""Header of streams whose coordinates were divided by a unit, which is the grid step in metres.

The stream is

    4 bytes  "PBUN"
    8 bytes  the unit, a little-endian double
    the stream of the codec
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

MAGIC = b"PBUN"
_UNIT = struct.Struct("<d")


class InUnits(NamedTuple):
    """A stream without the header of a unit, and the unit."""

    stream: bytes  # of the codec
    unit: float | None  # length of a step; None without a header


def with_unit(stream: bytes, unit: float) -> bytes:
    """Return a codec's stream after a header with the unit."""
    return MAGIC + _UNIT.pack(unit) + stream


def without_unit(stream: bytes) -> InUnits:
    """Separate a codec's stream from the header with the unit, if there is one.

    Raises InputError if the header is damaged.
    """
    if not stream.startswith(MAGIC):
        return InUnits(stream, None)
    start = len(MAGIC) + _UNIT.size
    if len(stream) < start:
        raise InputError("the stream is damaged (its unit)")
    (unit,) = _UNIT.unpack_from(stream, len(MAGIC))
    if not 0 < unit < np.inf:
        raise InputError("the stream is damaged (its unit)")
    return InUnits(stream[start:], unit)


def multiplied(points: Floats, unit: float) -> Floats:
    """Return points (m, 3) times the unit; raise InputError if a coordinate is not finite."""
    with np.errstate(over="ignore"):
        result: Floats = points * unit
    if not np.isfinite(result).all():
        raise InputError("the stream is damaged (its unit)")
    return result
