from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.coding.framing import Framing
from puckbench.lidar.returns import Returns
from puckbench.storage.packets import check_whole_packets, decode_packets, encode_packets


class PacketsCodec(ReturnsCodec):
    """Base class of lossless codecs of the data packets of Velodyne sensors.

    A subclass compresses packets, including reflectivities and times. Virtual scans are refused:
    without reflectivities, their packets would take fewer bytes than those of a real sensor.
    """

    metric_rates = lengths(2)
    any_length: ClassVar[bool] = False
    packets_alone: ClassVar[bool] = True
    pace = Pace(0.1, 4.0)
    line = ":"

    @abstractmethod
    def _packed(self, data: bytes) -> bytes: ...

    @abstractmethod
    def _unpacked(self, stream: bytes, most: int) -> bytes:
        """Decompress to at most `most` bytes; raise InputError if there are more, or damage."""

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def check_returns(self, returns: Returns) -> None:
        check_whole_packets(returns)

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        return self._framing.framed(encode_packets(returns, self._packed))

    def _decode_returns(self, stream: bytes) -> Returns:
        return decode_packets(self._framing.unframed(stream)[1], self._unpacked)
