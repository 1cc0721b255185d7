from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from puckbench.codecs.puck import Puck, PuckOptions
from puckbench.codecs.rates import lengths
from puckbench.codecs.registry import CODECS

CODE = ("puckbench.codecs.puck",)

_MAGIC = b"SMOOTH"


class PuckSmoothedOptions(PuckOptions):
    """Options of `puck` with a smaller default of lambda, since large errors bias the smoothing."""

    lmbda: float = Field(0.002, ge=0, description=PuckOptions.model_fields["lmbda"].description)


@CODECS.register("puck_smoothed")
class PuckSmoothed(Puck):
    """The codec is `puck` with a decoder that fits planes to returns and removes biases of lasers.

    Decoded returns are those of `puck`, and are lossless at the finest rate. Decoded points are
    estimates of the surface at every rate (see `puck.smoothing`).
    """

    rates = lengths(200, 100, 50, 20, 10, 4, 2)
    Options = PuckSmoothedOptions
    options: PuckSmoothedOptions
    magic = _MAGIC
    estimates = True

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return super().attribute_bytes(_without_magic(stream))

    def _stream(self, returns: Returns, step: int) -> bytes:
        return _MAGIC + super()._stream(returns, step)

    def decode(self, stream: bytes) -> PointCloud:
        from puck import decode_returns, range_steps, smoothed_points

        content = _without_magic(stream)
        returns = decode_returns(content)
        return PointCloud(smoothed_points(returns, range_steps(content)), returns=returns)


def _without_magic(stream: bytes) -> bytes:
    if not stream.startswith(_MAGIC):
        raise InputError("not a stream of puck_smoothed")
    return stream[len(_MAGIC) :]
