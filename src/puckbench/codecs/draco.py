"""Draco's two point-cloud coders, through DracoPy: the kd-tree and the sequential method.

Only geometry is encoded, as float32, within the cloud's bounding cube. With the kd-tree, DracoPy
merges points with equal float32 coordinates (Debian's ``draco_encoder`` keeps them), but not points
that become equal by quantisation.
"""

from __future__ import annotations

import math
import struct
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
from pydantic import Field

from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.coding.most_points import most_points
from puckbench.core.errors import NARROWER, InputError
from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats

_HEADER = struct.Struct("<5sBBBBHI")
"""Magic, major and minor version, encoder type, encoder method, flags, number of points."""
_POINT_CLOUD = 0
_MOST_BITS = {"kd_tree": 30, "sequential": 26}
"""Maximum bits per coordinate: 26 limit the memory of the sequential encoder (4 bytes per grid
step), and exceed the 24 bits of single precision."""

DRACO_RATES = {f"r{bits - 3}": {"quantization_bits": bits} for bits in range(4, 12)}
"""Rates of PCC Arena, which the thesis used."""


def _most_points(stream: bytes) -> int:
    """Return the largest plausible number of points in a stream, to limit the decoder's memory."""
    return min(65536 + 8192 * len(stream), most_points(len(stream)))


class DracoOptions(Model):
    compression_level: int = Field(
        10, ge=0, le=10, description="effort; 10 gives the smallest streams"
    )
    method: Literal["kd_tree", "sequential"] = Field(
        "kd_tree",
        description="the kd-tree reorders points; the sequential method keeps their order and "
        "duplicates",
    )


def _quantisation(points: Floats, parameters: Parameters, most_bits: int) -> dict[str, Any]:
    """Return the encoder's quantisation arguments for a rate.

    A rate is the number of bits per coordinate of the bounding cube, or a grid step in m.
    """
    if "step_m" not in parameters:
        return {"quantization_bits": parameters["quantization_bits"]}
    step = float(parameters["step_m"])
    least = np.floor(points.min(axis=0) / step)
    bits = max(1, math.ceil(math.log2(float((points.max(axis=0) / step - least).max()) + 2)))
    if bits > most_bits:
        raise InputError(f"the cloud is wider than 2^{most_bits} steps of {step:g} m{NARROWER}")
    width = step * ((1 << bits) - 1)
    origin = (least * step).tolist()
    return {
        "quantization_bits": bits, "quantization_range": width, "quantization_origin": origin
    }  # fmt: skip


@CODECS.register("draco")
class Draco(Codec):
    """Google's Draco, with the kd-tree or the sequential method (option `method`).

    A rate is the number of quantisation bits or, for clouds in metres, the grid step. The decoder
    reads streams of both methods.
    """

    title = "Draco"
    use = "a fast baseline that everybody has"
    colour = "#0072B2"
    marker = "o"
    rank = 0
    rates = DRACO_RATES
    metric_rates = lengths()
    Options: type[DracoOptions] = DracoOptions
    options: DracoOptions
    is_single_precision = True
    pace = Pace(0.02, 1.1)
    magic = b"DRACO"
    version = f"DracoPy {version('dracopy')}"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._most_bits = _MOST_BITS[self.options.method]
        self.most_steps = float(2**self._most_bits - 3)

    def load(self) -> None:
        import DracoPy  # noqa: F401

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        import DracoPy

        if np.abs(points).max() > np.finfo(np.float32).max / 2:
            raise InputError("coordinates exceed Draco's single precision")
        stream: bytes = DracoPy.encode(
            points.astype(np.float32),
            **_quantisation(points, parameters, self._most_bits),
            compression_level=self.options.compression_level,
            preserve_order=self.options.method == "sequential",
        )
        if len(points) > _most_points(stream):
            raise InputError(f"{len(points)} points fall on too few positions")
        return stream

    def _decode(self, stream: bytes) -> Floats:
        import DracoPy

        self._check_header(stream)
        try:
            points = DracoPy.decode(stream).points
        except (DracoPy.FileTypeException, ValueError, MemoryError) as error:
            raise InputError("the stream is damaged") from error
        if points is None or len(points) == 0 or not np.isfinite(points).all():
            raise InputError("the stream is damaged (no finite points)")
        return np.asarray(points, dtype=np.float64)

    def _check_header(self, stream: bytes) -> None:
        if len(stream) < _HEADER.size:
            raise InputError("the stream is truncated")
        magic, _, _, kind, _, _, points = _HEADER.unpack_from(stream)
        if magic != b"DRACO" or kind != _POINT_CLOUD:
            raise InputError("not a Draco point-cloud stream")
        if points > _most_points(stream):
            raise InputError(f"the stream is damaged (claims {points} points)")
