"""Encoder and decoder of points in Cloudini's format, version 5, by the package pureini.

Each coordinate is a FLOAT64 field with the step as resolution; Zstandard compresses the fields.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.codecs.storage.steps import check_points_of, check_steps

if TYPE_CHECKING:
    from pureini import PointcloudEncoder

MAGIC = b"CLOUDINI_V"
_NUMBERS = re.compile(rb".*\nwidth: (\d{1,9})\n.*? resolution: (\d*\.?\d+)\n", re.DOTALL)
_HEADER_BYTES = 600
_VERSION, _POINT_BYTES = 5, 24


def encode_cloudini(points: Floats, step: float) -> bytes:
    """Encode points in Cloudini's format, in their order.

    Parameters
    ----------
    points
        Points (n, 3) in m.
    step
        Resolution in m, to whose multiples coordinates are rounded.

    Raises
    ------
    InputError
        A coordinate exceeds 31 bits.
    """
    check_steps(points, step)
    stream = _encoder(len(points), step).encode(points.astype("<f8").tobytes())
    check_points_of(len(points), stream)
    return stream


def decode_cloudini(stream: bytes) -> Floats:
    """Decode points (n, 3), in m, from a stream that `encode_cloudini` wrote.

    Raises InputError if the stream is damaged or has other fields.
    """
    from pureini import PointcloudDecoder

    numbers = _NUMBERS.match(stream[:_HEADER_BYTES])
    count, step = (int(numbers[1]), float(numbers[2])) if numbers else (0, 0.0)
    if not numbers or not stream.startswith(_encoder(count, step).header):
        raise InputError("not Cloudini's format as puckbench writes it: x, y, z FLOAT64, version 5")
    check_points_of(count, stream)
    try:
        data, _ = PointcloudDecoder().decode(stream)
    except (RuntimeError, MemoryError) as error:
        raise InputError("the stream is damaged (Cloudini)") from error
    points: Floats = np.frombuffer(data, "<f8").reshape(-1, 3)
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its coordinates)")
    return points


def _encoder(count: int, step: float) -> PointcloudEncoder:
    from pureini import EncodingInfo, FieldType, PointcloudEncoder, PointField

    fields = [
        PointField(axis, 8 * place, FieldType.FLOAT64, step) for place, axis in enumerate("xyz")
    ]
    info = EncodingInfo(fields, width=count, point_step=_POINT_BYTES, version=_VERSION)
    return PointcloudEncoder(info)
