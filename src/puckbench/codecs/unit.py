"""Header with the unit: the grid step in metres, by which coordinates are divided.

The stream is

    4 bytes  "PBUN"
    8 bytes  the length of a step, a little-endian double
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
    stream: bytes  # of the codec
    unit: float | None  # length of a step; None without a header


def with_unit(stream: bytes, unit: float) -> bytes:
    return MAGIC + _UNIT.pack(unit) + stream


def without_unit(stream: bytes) -> InUnits:
    """Separate the header from the codec's stream; raise InputError if the header is damaged."""
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
    """Multiply points (m, 3) by `unit`; raise InputError if a result is not finite."""
    with np.errstate(over="ignore"):
        result: Floats = points * unit
    if not np.isfinite(result).all():
        raise InputError("the stream is damaged (its unit)")
    return result
