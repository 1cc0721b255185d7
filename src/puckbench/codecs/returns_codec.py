from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

from pointkit.coding.byte_io import stream_bytes
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import Codec, Parameters, Takes

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns


def step_in_quanta(returns: Returns, parameters: Parameters) -> int:
    """Return a rate's range step as a number of quanta (the sensor's range unit).

    It is rounded down, and at least 1.
    """
    return max(1, int(float(parameters["step_m"]) / returns.quantum_m + 1e-6))


class ReturnsCodec(Codec):
    """Base class of codecs that encode the returns of a spinning sensor instead of points.

    Returns are the measured ranges by turn (revolution), firing and laser. A subclass defines
    `metric_rates`, `_encode_returns` and `_decode_returns`. Decoded points are those of the decoded
    returns, unless `estimates` is true.
    """

    takes: ClassVar[Takes] = "returns"
    estimates: ClassVar[bool] = False
    """Whether decoded points are estimates of the surface, and not the points of the decoded
    returns."""

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Encode the returns of a spinning sensor at a rate to a byte string.

        Raises InputError as `encode` does, and if the format cannot hold the returns.
        """
        parameters = self.parameters_of(rate)
        if len(returns) == 0:
            raise InputError(f"codec {self.name}: there is no return to code")
        with naming(f"codec {self.name}"):
            self.check_returns(returns)
            return self._encode_returns(returns, parameters)

    def decode_returns(self, stream: bytes) -> Returns:
        """Decode a byte string to the returns of a spinning sensor.

        Raises InputError if the byte string is damaged or belongs to another codec.
        """
        with naming(f"codec {self.name}"):
            return self._decode_returns(stream_bytes(stream))

    def decode_cloud(self, stream: bytes) -> PointCloud:
        returns = self.decode_returns(stream)
        return PointCloud(returns.points(), returns=returns)

    def decode(self, stream: bytes) -> Floats:
        """Decode a byte string to points (m, 3) in m, in the sensor's coordinate frame."""
        return self.decode_cloud(stream).xyz

    def check_returns(self, returns: Returns) -> None:
        """Raise InputError if the codec cannot encode the returns."""

    @abstractmethod
    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        """Encode at least one return with the parameters of a rate."""

    @abstractmethod
    def _decode_returns(self, stream: bytes) -> Returns:
        """Decode returns; raise InputError as `decode_returns` does."""

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        raise InputError(
            f"codec {self.name}: codes the returns of a spinning sensor, not bare points"
        )

    def _decode(self, stream: bytes) -> Floats:
        return self.decode(stream)
