"""Encoder and decoder for differences between successive points, compressed by Zstandard.

This is Cloudini's scheme for ROS messages ``PointCloud2``, in another format. A stream's body is:

    float64  the step, m
    the number of points, base 128
    a Zstandard frame: x, y and z of each point minus those of the previous one, zigzag, base 128
"""

from __future__ import annotations

import struct

import numpy as np

from puckbench.coding.byte_io import Reader, base_128
from puckbench.coding.varints import packed_signed, unpacked_signed
from puckbench.coding.zstandard import compressed, decompressed
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.storage.steps import check_points_of, in_steps

_STEP = struct.Struct("<d")
_MAX_BYTES_PER_POINT = 15


def encode_differences(points: Floats, step: float, level: int) -> bytes:
    """Encode points (n, 3) in m, rounded to `step`, in their order; `level` (1 to 22) is that of
    Zstandard. Raise InputError if coordinates exceed 31 bits.
    """
    steps = in_steps(points, step)
    differences = np.diff(steps, axis=0, prepend=np.zeros((1, 3), np.int64))
    frame = compressed(packed_signed(differences.ravel()), level)
    check_points_of(len(points), frame)
    return _STEP.pack(step) + base_128(len(points)) + frame


def decode_differences(body: bytes) -> Floats:
    """Decode the points (n, 3) in a body; raise InputError if it is damaged."""
    reader = Reader(body)
    (step,) = _STEP.unpack(reader.take(_STEP.size))
    count = reader.number()
    frame = reader.rest()
    check_points_of(count, frame)
    data = decompressed(frame, _MAX_BYTES_PER_POINT * count)
    steps = np.cumsum(unpacked_signed(data, 3 * count).reshape(-1, 3), axis=0)
    with np.errstate(all="ignore"):
        points: Floats = steps * step
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its step)")
    return points
