"""The stream of a turn that Inter-LPCM codes.

* magic "LPCM", version, CRC-32 of the rest
* digest of the weights (8 bytes); CRC-32 of the preceding turn, or 0 without one; CRC-32 of all
  symbols; step of the corrections in m, and sum of all decoded coordinates (float64 each)
* number of lines, and of each line: number of points, azimuth of the first point (base-128
  numbers), radius and elevation of the first point (float32 each)
* azimuths, radii: smallest symbol and number of values (base-128 numbers), number of bytes, bytes
* elevations: number of bytes, bytes; corrections: the remaining bytes
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.inter_lpcm.symbols import MAX_SYMBOL
from pcc_networks.inter_lpcm.turn import MAX_LINE, STEPS_PER_TURN
from pointkit.coding.byte_io import Reader, base_128, signed_128
from pointkit.coding.framing import Framing
from pointkit.errors import InputError

MAGIC, VERSION = b"LPCM", 1
_FRAMING = Framing(MAGIC, VERSION, "Inter-LPCM")
_HEADER = struct.Struct("<8sIIdd")
_FIRST = struct.Struct("<ff")
_POINTS_PER_BYTE = 8
"""Points that a decoder accepts per byte of a stream; real turns have fewer than one."""
MAX_RADIUS = 1e5
"""Largest horizontal distance of a line's first point, m."""
_MOST_POINTS = 2**20


class Heads(NamedTuple):
    """First points of the lines.

    Parameters
    ----------
    lengths
        (lines,), numbers of points.
    azimuth
        (lines,), azimuth of the first point, in steps.
    radius, elevation
        (lines,), in m and degrees.
    """

    lengths: NDArray[np.int64]
    azimuth: NDArray[np.int64]
    radius: NDArray[np.float32]
    elevation: NDArray[np.float32]

    @property
    def starts(self) -> NDArray[np.int64]:
        """Where each line of the turn starts among all points, (lines + 1,).

        Line k consists of the points with indices from ``starts[k]`` to ``starts[k + 1] - 1``; the
        last element is therefore the number of all points.
        """
        return np.concatenate([[0], np.cumsum(self.lengths)])


class Part(NamedTuple):
    """Coded symbols of one kind, which lie between `least` and `most`."""

    least: int
    most: int
    data: bytes


@dataclass(frozen=True)
class LpcmStream:
    """A stream of Inter-LPCM, divided into the numbers of its header and its four coded parts."""

    digest: bytes  # of the weights
    reference: int  # CRC-32 of the preceding turn, or 0
    check: int  # CRC-32 of all symbols
    step: float  # of the corrections, m
    total: float  # sum of all decoded coordinates, m
    heads: Heads
    azimuth: Part
    radius: Part
    elevation: bytes
    corrections: bytes


def write_stream(content: LpcmStream) -> bytes:
    """Return the bytes of a stream; raise InputError if it has too many points for its bytes."""
    heads = content.heads
    body = [
        _HEADER.pack(content.digest, content.reference, content.check, content.step, content.total),
        base_128(len(heads.lengths)),
    ]
    for length, azimuth, radius, elevation in zip(*heads, strict=True):
        body += [base_128(int(length)), base_128(int(azimuth)), _FIRST.pack(radius, elevation)]
    for part in (content.azimuth, content.radius):
        body += [signed_128(part.least), base_128(part.most - part.least)]
        body += [base_128(len(part.data)), part.data]
    body += [base_128(len(content.elevation)), content.elevation]
    stream = _FRAMING.framed(b"".join([*body, content.corrections]))
    _check_points(heads, len(stream))
    return stream


def read_stream(stream: bytes) -> LpcmStream:
    """Divide a stream into its parts, without decoding their symbols.

    Raises
    ------
    InputError
        The stream is damaged, or of another codec or version.
    """
    reader = Reader(_FRAMING.unframed(stream)[1])
    digest, reference, check, step, total = _HEADER.unpack(reader.take(_HEADER.size))
    if not 0 < step <= MAX_RADIUS:
        raise InputError("the stream is damaged (its step)")
    heads = _read_heads(reader)
    _check_points(heads, len(stream))
    azimuth, radius = _read_part(reader), _read_part(reader)
    elevation = reader.take(reader.number())
    return LpcmStream(
        digest, reference, check, step, total, heads, azimuth, radius, elevation, reader.rest()
    )


def _read_heads(reader: Reader) -> Heads:
    count = reader.number()
    if not 0 < count <= len(reader.body) // _FIRST.size:
        raise InputError("the stream is damaged (its lines)")
    rows = []
    for _ in range(count):
        length, azimuth = reader.number(), reader.number()
        radius, elevation = _FIRST.unpack(reader.take(_FIRST.size))
        is_possible = (
            0 < length <= MAX_LINE and azimuth <= STEPS_PER_TURN and 0 <= radius <= MAX_RADIUS
        )
        if not is_possible or not abs(elevation) <= 90:
            raise InputError("the stream is damaged (a line)")
        rows.append((length, azimuth, radius, elevation))
    lengths, azimuths, radii, elevations = zip(*rows, strict=True)
    return Heads(
        np.array(lengths, np.int64),
        np.array(azimuths, np.int64),
        np.array(radii, np.float32),
        np.array(elevations, np.float32),
    )


def _read_part(reader: Reader) -> Part:
    least = reader.signed()
    most = least + reader.number()
    if least < -MAX_SYMBOL or most > MAX_SYMBOL:
        raise InputError("the stream is damaged (its symbols)")
    return Part(least, most, reader.take(reader.number()))


def _check_points(heads: Heads, size: int) -> None:
    if int(heads.lengths.sum()) > min(_POINTS_PER_BYTE * size, _MOST_POINTS):
        raise InputError("too many points for the size of the stream")
