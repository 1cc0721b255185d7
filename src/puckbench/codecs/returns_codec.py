"""Codecs that code the returns of a spinning sensor, not the points that follow from them."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

from puckbench.codecs.base import Codec, Parameters, Takes
from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats, PointCloud

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


def step_in_quanta(returns: Returns, parameters: Parameters) -> int:
    """A rate's step of ranges in those of the sensor, at least one."""
    return max(1, round(float(parameters["step_m"]) / returns.quantum_m))


class ReturnsCodec(Codec):
    """A codec of returns; the points of a stream are those of the returns in it, or estimates.

    A subclass names its `metric_rates` and implements `_encode_returns` and `_decode_returns`.
    """

    takes: ClassVar[Takes] = "returns"
    estimates: ClassVar[bool] = False
    """Whether decoded points are estimates of the surface, not those of the decoded returns."""

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Code returns at a named rate.

        Raises
        ------
        InputError
            An unknown rate, no return, or returns that the codec cannot hold.
        """
        parameters = self.parameters_of(rate)
        if len(returns) == 0:
            raise InputError(f"codec {self.name}: there is no return to code")
        with naming(f"codec {self.name}"):
            self.check_returns(returns)
            return self._encode_returns(returns, parameters)

    def decode_returns(self, stream: bytes) -> Returns:
        """The returns of a stream; InputError for a damaged or a foreign one."""
        with naming(f"codec {self.name}"):
            return self._decode_returns(stream)

    def decode_cloud(self, stream: bytes) -> PointCloud:
        """The returns of a stream, and their points."""
        returns = self.decode_returns(stream)
        return PointCloud(returns.points(), returns=returns)

    def decode(self, stream: bytes) -> Floats:
        """Points (m, 3) in metres in the sensor's frame."""
        return self.decode_cloud(stream).xyz

    def check_returns(self, returns: Returns) -> None:
        """Raise InputError for returns that the codec cannot hold; by default it holds all."""

    @abstractmethod
    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        """Code returns, at least one, with a rate's parameters."""

    @abstractmethod
    def _decode_returns(self, stream: bytes) -> Returns:
        """The returns of a stream; InputError for a damaged or a foreign one."""

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        raise InputError(
            f"codec {self.name}: codes the returns of a spinning sensor, not bare points"
        )

    def _decode(self, stream: bytes) -> Floats:
        return self.decode(stream)
