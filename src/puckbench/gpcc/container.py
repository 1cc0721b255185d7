"""Container of a G-PCC stream: a magic, and the frame that G-PCC itself cannot signal.

    4 bytes  "PBGP"
    1 byte   0: the stream follows; 1: unit and offset (4 float64, little-endian), then the stream

A bare stream, as TMC13 writes it, begins with a sequence parameter set: type 0 and its length in
four bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.gpcc.grid import Frame

MAGIC = b"PBGP"
_FRAME = struct.Struct("<4d")


class Packed(NamedTuple):
    """A bare G-PCC stream and the frame of its coordinates."""

    stream: bytes
    frame: Frame


def packed(stream: bytes, frame: Frame) -> bytes:
    """The stream after its magic, with the frame where it is not the input's own."""
    if frame == Frame():
        return MAGIC + b"\0" + stream
    return MAGIC + b"\1" + _FRAME.pack(frame.unit, *frame.offset) + stream


def unpacked(data: bytes) -> Packed:
    """The stream and its frame; a bare stream has the input's own. InputError when damaged."""
    if not data.startswith(MAGIC):
        if not data.startswith(b"\0\0\0"):
            raise InputError("not a G-PCC stream")
        return Packed(data, Frame())
    start = len(MAGIC) + 1
    if data[start - 1 : start] == b"\0":
        return Packed(data[start:], Frame())
    if data[start - 1 : start] != b"\1" or len(data) < start + _FRAME.size:
        raise InputError("the stream's first bytes are damaged")
    unit, *offset = _FRAME.unpack_from(data, start)
    if not (0 < unit < np.inf and np.isfinite(offset).all()):
        raise InputError("the stream's first bytes are damaged (no finite frame)")
    return Packed(data[start + _FRAME.size :], Frame(unit, (offset[0], offset[1], offset[2])))
