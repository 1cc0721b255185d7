from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from puckbench.codecs.base import Takes
from puckbench.codecs.gpcc import OwnCodec
from puckbench.geometry.cloud import check_points

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


class SensorCodec(OwnCodec):
    """Base class of codecs that use the sensor's lasers to encode clouds with returns."""

    takes: ClassVar[Takes] = "either"

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        parameters, points = self.parameters_of(rate), returns.points()
        check_points(points, f"codec {self.name}")
        return self._encoded(points, parameters, returns)
