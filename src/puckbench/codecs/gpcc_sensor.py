"""What codecs of G-PCC have in common that use the sensor of a cloud's returns."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from puckbench.codecs.base import Takes
from puckbench.codecs.gpcc import OwnCodec
from puckbench.geometry.cloud import check_points

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


class SensorCodec(OwnCodec):
    """Codes a cloud with its sensor's lasers where it has returns, else without."""

    takes: ClassVar[Takes] = "either"

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Code a spinning sensor's returns at a named rate; InputError as for `encode`."""
        parameters, points = self.parameters_of(rate), returns.points()
        check_points(points, f"codec {self.name}")
        return self._encoded(points, parameters, returns)
