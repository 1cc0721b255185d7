"""Rounded coordinates as differences from point to point, in variable-length bytes, by Zstandard.

The scheme of Cloudini, which the ROS community stores ``PointCloud2`` messages with; the code and
the stream are our own. A stream is framed (`common.framing`):

    float64  the step, m
    the number of points, base 128
    a frame of Zstandard: x, y, z of each point less those of the one before, zigzag, base 128
"""

from __future__ import annotations

import struct

import numpy as np
from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.steps import MOST_STEPS, check_points_of, in_steps
from puckbench.coding.byte_io import Reader, base_128
from puckbench.coding.framing import Framing
from puckbench.coding.varints import packed_signed, unpacked_signed
from puckbench.coding.zstandard import compressed, decompressed
from puckbench.core.errors import InputError, naming
from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats

_STEP = struct.Struct("<d")
_BYTES_OF_POINT = 15


class DeltaZstdOptions(Model):
    """Options of differences by Zstandard."""

    level: int = Field(19, ge=1, le=22, description="of Zstandard; Cloudini's own is 1")


@CODECS.register("delta_zstd")
class DeltaZstd(Codec):
    """Differences from point to point by Zstandard, the scheme of Cloudini; keeps the order.

    A rate is the step that coordinates are rounded to.
    """

    title = "Delta + Zstandard"
    use = "PointCloud2 messages: quick, in their order (the scheme of Cloudini)"
    colour = "#E7298A"
    marker = "+"
    line = "--"
    rank = 150
    pace = Pace(0.02, 2.0)
    metric_rates = lengths()
    most_steps = MOST_STEPS
    Options = DeltaZstdOptions
    options: DeltaZstdOptions
    magic = b"PBDZ"
    version = f"puckbench {__version__}"

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        step = float(parameters["step_m"])
        with naming(f"codec {self.name}"):
            steps = in_steps(points, step)
            moves = np.diff(steps, axis=0, prepend=np.zeros((1, 3), np.int64))
            coded = compressed(packed_signed(moves.ravel()), self.options.level)
            check_points_of(len(points), coded)
        return self._framing.framed(_STEP.pack(step) + base_128(len(points)) + coded)

    def _decode(self, stream: bytes) -> Floats:
        with naming(f"codec {self.name}"):
            reader = Reader(self._framing.unframed(stream)[1])
            (step,) = _STEP.unpack(reader.take(_STEP.size))
            count = reader.number()
            coded = reader.rest()
            check_points_of(count, coded)
            moves = unpacked_signed(decompressed(coded, _BYTES_OF_POINT * count), 3 * count)
            return _in_metres(np.cumsum(moves.reshape(-1, 3), axis=0), step)


def _in_metres(steps: Floats, step: float) -> Floats:
    with np.errstate(all="ignore"):
        points: Floats = steps * step
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its step)")
    return points
