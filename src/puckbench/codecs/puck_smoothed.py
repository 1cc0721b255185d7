from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from puckbench.codecs.base import Pace, lengths
from puckbench.codecs.puck import Puck, PuckOptions
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

    title = "Puck, smoothed"
    use = "scans of spinning sensors, nearer to the surface than they were"
    colour = "#8F7AE5"
    marker = "p"
    line = "--"
    rank = 6
    metric_rates = lengths(200, 100, 50, 20, 10, 4, 2)
    Options = PuckSmoothedOptions
    options: PuckSmoothedOptions
    magic = _MAGIC
    estimates: ClassVar[bool] = True
    pace = Pace(0.05, 3.0)

    def _stream(self, returns: Returns, step: int) -> bytes:
        return _MAGIC + super()._stream(returns, step)

    def _decode_returns(self, stream: bytes) -> Returns:
        return super()._decode_returns(_without_magic(stream))

    def decode_cloud(self, stream: bytes) -> PointCloud:
        from puck import range_steps, smoothed_points

        with naming(f"codec {self.name}"):
            returns = self._decode_returns(stream)
            steps = range_steps(_without_magic(stream))
        return PointCloud(smoothed_points(returns, steps), returns=returns)


def _without_magic(stream: bytes) -> bytes:
    if not stream.startswith(_MAGIC):
        raise InputError("not a stream of puck_smoothed")
    return stream[len(_MAGIC) :]
