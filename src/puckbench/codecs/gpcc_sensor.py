from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from puckbench.codecs.base import Takes
from puckbench.codecs.gpcc import OwnCodec
from puckbench.geometry.cloud import check_points

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


class SensorCodec(OwnCodec):
    """Encodes a cloud with the lasers of its sensor if it has returns, else without."""

    takes: ClassVar[Takes] = "either"

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Encode the returns of a spinning sensor at a rate; raise InputError as `encode` does."""
        parameters, points = self.parameters_of(rate), returns.points()
        check_points(points, f"codec {self.name}")
        return self._encoded(points, parameters, returns)
