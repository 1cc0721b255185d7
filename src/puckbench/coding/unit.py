"""The unit of a stream whose coder knows steps of a grid alone.

A codec made for clouds on a grid can be given clouds in metres where it is told how long a step is.
Its stream then begins with

    4 bytes  "PBUN"
    8 bytes  the length of a step, a little-endian double

and goes on with the codec's own stream.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

MAGIC = b"PBUN"
_UNIT = struct.Struct("<d")


class InUnits(NamedTuple):
    """A codec's own stream, and the length of a step; None where coordinates are the input's."""

    stream: bytes
    unit: float | None


def with_unit(stream: bytes, unit: float) -> bytes:
    """The stream of a cloud whose coordinates were divided by `unit`."""
    return MAGIC + _UNIT.pack(unit) + stream


def without_unit(stream: bytes) -> InUnits:
    """A codec's own stream and its unit; InputError when that is damaged."""
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
    """Points (m, 3) of steps as lengths; InputError where doubles cannot hold them."""
    with np.errstate(over="ignore"):
        found: Floats = points * unit
    if not np.isfinite(found).all():
        raise InputError("the stream is damaged (its unit)")
    return found
