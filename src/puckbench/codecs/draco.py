"""Draco's two point-cloud coders, run through DracoPy: the kd-tree and the sequential method.

Only geometry is encoded, as float32, within the cloud's bounding cube. With the kd-tree, DracoPy
merges points with equal float32 coordinates (Debian's ``draco_encoder`` keeps them). It does not
merge points that become equal by quantisation.

Quantisation to a length has an error of half a step. Single precision adds up to 1/8 step, if
neither the extent nor the coordinates exceed `_FINE` steps. Other clouds are first rounded to the
grid in double precision. Then their grid positions are encoded as a generic attribute of integers,
beside coordinates of 0. Two headers before the stream contain the step (`puckbench.codecs.unit`)
and the lowest position (`puckbench.codecs.shift`).

If single precision does not resolve the step at the cloud's distance from the origin, the cloud is
shifted to the origin first.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, PointCloud, bounds
from pointkit.models import Model
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.most_points import most_points
from puckbench.codecs.rates import Parameters, lengths, parameters_of
from puckbench.codecs.registry import CODECS
from puckbench.codecs.shift import moved, shift_of, shifted, unshifted
from puckbench.codecs.unit import multiplied, with_unit, without_unit

CODE = ("puckbench.codecs.most_points",)

_HEADER = struct.Struct("<5sBBBBHI")
"""Magic, major and minor version, encoder type, encoder method, flags, number of points."""
_POINT_CLOUD = 0
_MOST_BITS = {"kd_tree": 30, "sequential": 26}
"""Maximum bits per coordinate at a length: 26 limit the memory of the sequential encoder (4 bytes
per grid step)."""
_GENERIC = 4
"""Draco's type of generic attributes."""
_FINE = 1 << 19
"""Up to this many steps, single precision resolves 1/32 step."""

DRACO_RATES = {f"r{bits - 3}": {"quantization_bits": bits} for bits in range(4, 12)}
"""Rates of PCC Arena, which the thesis used."""


def _most_points(stream: bytes) -> int:
    """Return the largest plausible number of points in a stream; it limits the decoder's memory."""
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


def _is_wide(points: Floats, step: float) -> bool:
    low, high = bounds(points)
    return float(max(-low.min(), high.max(), (high - low).max())) > _FINE * step


def _quantisation(points: Floats, parameters: Parameters) -> dict[str, Any]:
    """Return the arguments with which DracoPy quantises at a rate."""
    if "step_m" not in parameters:
        return {"quantization_bits": parameters["quantization_bits"]}
    step = float(parameters["step_m"])
    least = np.floor(points.min(axis=0) / step)
    bits = max(1, math.ceil(math.log2(float((points.max(axis=0) / step - least).max()) + 2)))
    width = step * ((1 << bits) - 1)
    origin = (least * step).tolist()
    return {
        "quantization_bits": bits, "quantization_range": width, "quantization_origin": origin
    }  # fmt: skip


@CODECS.register("draco")
class Draco(Codec):
    """The codec is Google's Draco with its kd-tree or its sequential method (option `method`).

    A rate is the number of quantisation bits or, for clouds in metres, the grid step. The decoder
    reads streams of both methods.
    """

    rates: Mapping[str, Parameters] = {**DRACO_RATES, **lengths()}
    Options: type[DracoOptions] = DracoOptions
    options: DracoOptions
    magic = b"DRACO"
    version = f"DracoPy {version('dracopy')}"

    @property
    def _most_steps(self) -> float:
        """Largest extent along an axis, in steps of the grid."""
        return float(2 ** _MOST_BITS[self.options.method] - 3)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = self._most_steps * parameters_of(self, rate).get("step_m", math.inf)
        return super().skip(cloud, rate) or cloud.wider_than(most_m)

    def load(self) -> None:
        import DracoPy  # noqa: F401

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        parameters = parameters_of(self, rate)
        shift = shift_of(cloud.xyz, parameters.get("step_m"))
        if shift is None:
            return self._encoded(cloud.xyz, parameters)
        return shifted(self._encoded(cloud.xyz - shift, parameters), shift)

    def _encoded(self, points: Floats, parameters: Parameters) -> bytes:
        if np.abs(points).max() > np.finfo(np.float32).max / 2:
            raise InputError("coordinates exceed Draco's single precision")
        step = float(parameters.get("step_m", math.inf))
        if _is_wide(points, step):
            return self._encode_wide(points, step)
        return self._written(points.astype(np.float32), **_quantisation(points, parameters))

    def _encode_wide(self, points: Floats, step: float) -> bytes:
        positions = np.rint(points / step)
        least = positions.min(axis=0)
        positions -= least
        if positions.max() > self._most_steps + 1:  # the extent, rounded at both ends
            bits = _MOST_BITS[self.options.method]
            raise InputError(f"the cloud is wider than 2^{bits} steps of {step:g} m{NARROWER}")
        stream = self._written(
            np.zeros((len(points), 3), np.float32),
            quantization_bits=1,
            quantization_range=1.0,
            generic_attributes={0: positions.astype(np.uint32)},
        )
        return with_unit(shifted(stream, least), step)

    def _written(self, coordinates: NDArray[np.float32], **options: Any) -> bytes:
        import DracoPy

        stream: bytes = DracoPy.encode(
            coordinates,
            **options,
            compression_level=self.options.compression_level,
            preserve_order=self.options.method == "sequential",
        )
        if len(coordinates) > _most_points(stream):
            raise InputError(f"{len(coordinates)} points fall on too few positions")
        return stream

    def decode(self, stream: bytes) -> PointCloud:
        content, shift = unshifted(stream)
        points = self._decoded(content)
        return PointCloud(points if shift is None else moved(points, shift))

    def _decoded(self, stream: bytes) -> Floats:
        content, step = without_unit(stream)
        if step is None:
            return np.asarray(self._read(stream).points, dtype=np.float64)
        content, least = unshifted(content)
        generic = [
            attribute["data"]
            for attribute in self._read(content).attributes
            if attribute["attribute_type"] == _GENERIC
        ]
        if least is None or len(generic) != 1 or generic[0].shape[1:] != (3,):
            raise InputError("the stream is damaged (its grid)")
        return multiplied(moved(generic[0].astype(np.float64), least), step)

    def _read(self, stream: bytes) -> Any:
        import DracoPy

        self._check_header(stream)
        try:
            cloud = DracoPy.decode(stream)
        except (DracoPy.FileTypeException, ValueError, MemoryError) as error:
            raise InputError("the stream is damaged") from error
        points = cloud.points
        if points is None or len(points) == 0 or not np.isfinite(points).all():
            raise InputError("the stream is damaged (no finite points)")
        return cloud

    def _check_header(self, stream: bytes) -> None:
        if len(stream) < _HEADER.size:
            raise InputError("the stream is truncated")
        magic, _, _, kind, _, _, points = _HEADER.unpack_from(stream)
        if magic != b"DRACO" or kind != _POINT_CLOUD:
            raise InputError("not a Draco point-cloud stream")
        if points > _most_points(stream):
            raise InputError(f"the stream is damaged (claims {points} points)")
